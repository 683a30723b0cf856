"""Importing motions: their files, their subjects and activities, and reports on damaged files."""

import hashlib
import re

import numpy as np
import pytest
from valid_files import BVH

from workbench.cli.main import main
from workbench.motion.library import read_library
from workbench.motion.sources import cmu_clips, find_sources, import_sources, load_motion
from workbench.utils.errors import InputError

# the bones of the CMU database with lengths (1/0.45 inch) of a synthetic person
BONES = {
    "lowerback": ("root", (0, 1, 0), 6), "lowerneck": ("lowerback", (0, 1, 0), 2),
    "upperneck": ("lowerneck", (0, 1, 0), 1.7), "head": ("upperneck", (0, 1, 0), 1.8),
}  # fmt: skip
for _side, _x in (("l", 1), ("r", -1)):
    _leg = (0.34202 * _x, -0.939693, 0)
    for _name, _parent, _direction, _length in (
        ("hipjoint", "root", (0.7 * _x, -0.714143, 0), 2.5), ("femur", "{}hipjoint", _leg, 7.3),
        ("tibia", "{}femur", _leg, 7.5), ("foot", "{}tibia", (0, 0, 1), 2),
        ("clavicle", "lowerback", (0.9 * _x, 0.435890, 0), 3.5), ("humerus", "{}clavicle", (_x, 0, 0), 5),
        ("radius", "{}humerus", (_x, 0, 0), 3), ("wrist", "{}radius", (_x, 0, 0), 1.5),
        ("hand", "{}wrist", (_x, 0, 0), 1),
    ):  # fmt: skip
        BONES[_side + _name] = (_parent.format(_side), _direction, _length)


def asf_text():
    lines = [":units", "length 0.45", "angle deg", ":root", "order TX TY TZ RX RY RZ", "axis XYZ", ":bonedata"]
    for name, (_, direction, length) in BONES.items():
        lines += ["begin", f"name {name}", "direction {} {} {}".format(*direction), f"length {length}"]
        knee = name.endswith("tibia")
        lines += [f"axis 0 0 {20 * np.sign(direction[0]) if knee else 0} XYZ", *(["dof rx"] if knee else []), "end"]
    lines += [":hierarchy", "begin", *(f"{parent} {name}" for name, (parent, _, _) in BONES.items()), "end"]
    return "\n".join(lines)


def amc_text(n=9):
    frames = (f"{f}\nroot 0 18 {0.1 * f} 0 0 0\nltibia {f}\nrtibia {10 - f}\n" for f in range(1, n + 1))
    return ":DEGREES\n" + "".join(frames)


@pytest.fixture
def cmu(tmp_path):
    """A folder with the layout of the CMU database: two subjects, three clips."""
    folder = tmp_path / "cmu"
    for subject, clips in (("07", ("07_01", "07_02")), ("35", ("35_01",))):
        (folder / subject).mkdir(parents=True)
        (folder / subject / f"{subject}.asf").write_text(asf_text())
        for clip in clips:
            (folder / subject / f"{clip}.amc").write_text(amc_text())
    (folder / "index.csv").write_text(
        "clip,subject,activity,frames,first_frame_number,rate_hz\n"
        '07_01,07,walk,9,1,120\n07_02,07,"walk, then run",9,1,60\n35_01,35,walk,9,1,120\n'
    )
    return folder


def test_sources_in_folders_are_listed_once_and_in_order(cmu, tmp_path):
    (cmu / "35" / "B.BVH").write_text("")
    sources = find_sources([cmu / "35" / "35_01.amc", cmu, str(cmu / "07")])
    names = [str(path.relative_to(cmu)) for path in sources]
    assert names == ["35/35_01.amc", "07/07_01.amc", "07/07_02.amc", "35/B.BVH"]
    (tmp_path / "empty").mkdir()
    for path in (cmu / "none.bvh", cmu / "index.csv", tmp_path / "empty"):
        with pytest.raises(InputError, match=re.escape(f"{path}: expected motion files")):
            find_sources([cmu, path])


def test_a_motion_has_its_source_subject_and_licence(cmu, tmp_path):
    path = cmu / "07" / "07_02.amc"
    motion = load_motion(path)
    assert (motion.name, motion.subject, motion.activity, motion.rate_hz) == ("07_02", "07", "walk, then run", 60.0)
    assert motion.source == "07/07_02.amc"
    assert motion.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert "NSF EIA-0196217" in motion.licence
    assert motion.joint_error_mm.max() < 0.01  # six digits of the bones' directions
    # the file's z axis points forwards
    assert np.diff(motion.poses[:, 0]) == pytest.approx(0.1 * 0.0254 / 0.45, abs=1e-6)

    (cmu / "index.csv").unlink()
    motion = load_motion(path)
    assert (motion.subject, motion.activity, motion.rate_hz) == ("07", "unknown", 120.0)
    other = tmp_path / "own.amc"
    other.write_text(amc_text())
    (tmp_path / "own.asf").write_text(asf_text())
    motion = load_motion(other)
    assert (motion.subject, motion.activity, motion.licence) == ("unknown", "unknown", "unknown")


def test_walks_are_selected_by_subject(cmu):
    clips = cmu_clips(cmu.parent, ["35", "07"])
    assert [path.name for path in clips] == ["07_01.amc", "35_01.amc"]  # "walk, then run" is not exactly "walk"
    with pytest.raises(InputError, match="expected clips of subject '99' with activity 'walk'"):
        cmu_clips(cmu.parent, ["07", "99"])
    (cmu / "35" / "35_01.amc").unlink()
    with pytest.raises(InputError, match=r"35_01\.amc: no such file, but the index lists it"):
        cmu_clips(cmu.parent, ["35"])
    with pytest.raises(InputError, match=r"index\.csv: no such file"):
        cmu_clips(cmu, ["35"])


def test_a_damaged_clip_is_reported_and_the_others_are_imported(cmu):
    (cmu / "07" / "07_01.amc").write_text(amc_text()[:-20])
    (cmu / "35" / "other.bvh").write_text(BVH)
    motions, reports = import_sources([cmu, cmu / "none.bvh"], rate_hz=30.0)
    clips = [(motion.name, motion.rate_hz, len(motion)) for motion in motions]
    assert clips == [("07_02", 30.0, 5), ("35_01", 30.0, 3)]
    assert len(reports) == 3
    assert "none.bvh: expected motion files" in reports[0]
    assert "07_01.amc, line" in reports[1]
    assert "other.bvh: clip other: found no joint for neck" in reports[2]
    motions, reports = import_sources([cmu / "35" / "35_01.amc"], rate_hz=1.0)
    assert motions == []
    assert "two frames or more at 1 Hz" in reports[0]
    with pytest.raises(InputError, match="import: expected a rate of"):
        import_sources([cmu], rate_hz=0.0)


def test_the_command_writes_a_library_and_a_table(cmu, tmp_path, capsys):
    output = tmp_path / "out.h5"
    assert main(["import", str(cmu), "-o", str(output), "--rate", "60"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    rows = [line.split()[:3] for line in printed.out.splitlines()[1:]]
    assert rows == [["07", "2", "14"], ["35", "1", "5"], ["all", "3", "19"]]
    assert [motion.name for motion in read_library(output)] == ["07_01", "07_02", "35_01"]


def test_the_command_skips_what_cannot_be_imported(cmu, tmp_path, capsys):
    output = tmp_path / "out.h5"
    output.write_text("existing")
    assert main(["import", str(tmp_path / "none"), "-o", str(output)]) == 2
    assert output.read_text() == "existing"
    assert "nothing imported" in capsys.readouterr().out
    (cmu / "35" / "35_01.amc").write_text("")
    assert main(["import", str(cmu), str(tmp_path / "none"), "-o", str(output)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 2
    assert "35_01.amc, line 1: expected frames, found none" in errors
    assert [motion.name for motion in read_library(output)] == ["07_01", "07_02"]
