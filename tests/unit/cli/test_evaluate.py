"""`workbench evaluate` scores the formats that the workbench itself writes, with the recording's own errors."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rerun.chunk import RrdReader

import workbench as wb
from workbench.cli.main import main
from workbench.recording.read.chunks import timed

RECORDING = Path(__file__).parents[3] / "recordings/baselines/points_walk_steady.rrd"
pytestmark = pytest.mark.skipif(not RECORDING.is_file(), reason="needs the stored recordings")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluate")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.recording.read.crash_probe.crashing_recordings", lambda paths: set())
        for suffix in ("trc", "csv", "bvh"):
            assert main(["export", str(RECORDING), "-o", str(folder / f"own.{suffix}")]) == 0
        assert main(["export", str(RECORDING), "--truth", "-o", str(folder / "true.trc")]) == 0
    return folder


def test_every_format_has_the_errors_that_were_recorded(files, capsys, trusted):
    own = [str(files / f"own.{suffix}") for suffix in ("trc", "csv", "bvh")]
    command = ["evaluate", *own, "--truth", str(files / "true.trc"), "-o", str(files / "out"), "--offset", "0"]
    assert main(command) == 0
    assert main(["evaluate", str(RECORDING), "--truth", str(RECORDING), "-o", str(files / "recording")]) == 0
    tables = [pd.read_csv(files / folder / "scores.csv") for folder in ("out", "recording")]
    scores = pd.concat(tables)
    errors = scores[(scores["score"] == "mpjpe") & ~scores["estimate"].str.contains("−")]["value"]
    assert len(errors) == 4
    np.testing.assert_allclose(errors, np.mean(wb.read(RECORDING).metric("mpjpe_abs_mm")[1]), atol=0.1)
    assert "mean joint error (mm)" in capsys.readouterr().out
    for name in ("joints.csv", "angles.csv", "scores.md", "scores.tex"):
        assert (files / "out" / name).stat().st_size > 50
    (recording, *_) = sorted((files / "out").glob("*.rrd"))
    entities = {chunk.entity_path for chunk in RrdReader(recording).stream()}
    assert {"/world/estimate/skeleton", "/world/truth/skeleton"} <= entities


@pytest.mark.parametrize(
    ("estimate", "n_angles", "swapped"),
    [("own.mot", 19, False), ("own.trc", 4, False), ("own.trc", 4, True), (str(RECORDING), 19, False)],
)
def test_angles_of_opensim_are_those_of_the_recording_and_its_joints(files, capsys, estimate, n_angles, swapped):
    mot, other = files / "angles.mot", files / estimate
    for path in (mot, files / "own.mot"):
        assert main(["export", str(RECORDING), "-o", str(path)]) == 0
    first_s = float(timed(RECORDING, "true_joints")[1][0]) if other == RECORDING else 0.0  # files begin at 0
    own, true = (mot, other) if swapped else (other, mot)
    out = files / "angles"
    assert main(["evaluate", str(own), "--truth", str(true), "-o", str(out), f"--offset={-first_s}"]) == 0
    printed = capsys.readouterr().out
    assert f"{n_angles} angles in 12 frames" in printed
    assert "rmse_deg" in printed
    angles = pd.read_csv(out / "angles.csv").set_index("angle")["rmse_deg"]
    assert len(angles) == n_angles
    assert {"left_knee", "right_elbow"} <= set(angles.index)
    assert angles.max() < 0.01  # the angle between the limbs is a hinge's flexion, where that is positive


@pytest.mark.parametrize("arguments", [
    ["own.trc", "--truth", "absent.trc"], ["own.trc", "--truth", "own.trc", "--align", "both"],
    ["own.trc", "--truth", "."], ["damaged.mot", "--truth", "own.trc"],
])  # fmt: skip
def test_bad_input_is_one_sentence(files, monkeypatch, capsys, arguments):
    monkeypatch.chdir(files)
    Path("damaged.mot").write_text("name\nendheader\ntime knee_angle_r\n0 1\n0.1 one\n")
    assert main(["evaluate", *arguments]) == 2
    assert capsys.readouterr().err.count("\n") == 1
