"""The commands of the page on a user's own video run on short clips of recorded people."""

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from workbench.cameras.camera_file import load_cameras, write_cameras
from workbench.cli.main import main
from workbench.detections.detector.model_file import MODELS
from workbench.utils.decode import decode

N = 12
"""Frames of each clip."""
PAGE = Path(__file__).parents[2] / "docs" / "howto" / "own_video.md"
BLOCKS = re.findall(r"```sh\n(.+?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
COMMANDS = [
    line for block in BLOCKS for line in block.replace("\\\n", " ").splitlines()
    if line.startswith(("workbench track", "workbench detect"))
]  # fmt: skip


def _cut_clip(source, first, last, target):
    """Copy frames of a video to a new video of 30 frames a second."""
    images = list(decode(source, first, last))
    target.parent.mkdir(exist_ok=True)
    size = images[0].shape[1::-1]
    video = cv2.VideoWriter(str(target), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, size)
    for image in images:
        video.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    video.release()


@pytest.fixture(scope="module")
def folder(data, tmp_path_factory):
    """Return a folder with the files that the page names: clips, calibrations and annotated joints."""
    folder = tmp_path_factory.mktemp("own_video")
    woman, man = data / "sports2d_walk", data / "pose2sim_balance"
    _cut_clip(woman / "demo.mp4", 60, 60 + N - 1, folder / "walk.mp4")
    shutil.copy(woman / "Calib_demo.toml", folder / "camera.toml")
    rows = (woman / "keypoints.csv").read_text(encoding="utf-8").splitlines()
    shifted = [row.split(",", 1) for row in rows[1:]]
    annotations = [f"{int(frame) - 60},{rest}" for frame, rest in shifted if 60 <= int(frame) < 60 + N]
    (folder / "annotations.csv").write_text("\n".join([rows[0], *annotations]) + "\n", encoding="utf-8")
    for name, camera in (("left", "cam01"), ("right", "cam04")):
        _cut_clip(man / f"{camera}.mp4", 0, N - 1, folder / f"{name}.mp4")
    first, _, _, fourth = load_cameras(man / "Calib_qualisys.toml")
    rig = [replace(first, name="left"), replace(fourth, name="right")]
    write_cameras(folder / "rig.toml", rig, 0.0, {})
    (folder / "trials").mkdir()
    for name in ("walk", "walk2"):  # people in the first one have been detected by an earlier command
        shutil.copy(folder / "walk.mp4", folder / "trials" / f"{name}.mp4")
    (folder / "cache" / "models").mkdir(parents=True)
    shutil.copy(data / "blazepose" / MODELS["full"].file, folder / "cache" / "models")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_tracks_a_person(command, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("WORKBENCH_CACHE", str(folder / "cache"))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    words = shlex.split(command.replace("hydra/launcher=joblib hydra.launcher.n_jobs=4", ""))[1:]
    words = [str(path) for word in words for path in (sorted(Path().glob(word)) if "*" in word else [word])]
    before = set(Path().rglob("person.trc"))
    assert main(words) == 0, capsys.readouterr().err
    n_runs = 2 if "--each" in words else 1
    assert words[0] == "detect" or len(set(Path().rglob("person.trc")) - before) == n_runs
