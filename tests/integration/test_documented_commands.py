"""Every command of the documentation runs, at small size, in a folder with the files that it names."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bandai_files import write_bandai_like
from hydra.core.global_hydra import GlobalHydra
from observed_walkers import camera_arc, walker_joints
from openpose_scenes import points, write
from rendered_boards import board_poses, lens, rendered

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera_file import write_cameras
from workbench.cli.main import main
from workbench.datasets.points import Points
from workbench.motion.sources import find_motion

N = 6
"""Number of frames of videos and point clouds."""
CORNERS, SQUARE_MM = "7x4", "50"
"""Inner corners and square size of the rendered calibration boards."""
_LAYOUT = "BODY_25B"


def write_own_files(folder):
    """Write walk.mp4 with annotations.csv and joints.csv; one.mp4 and two.mp4 with their detections and board videos;
    camera.toml and calibration.toml; points/; clips/ and my_walk.bvh."""
    one, two = (replace(camera.scaled(0.25), name=f"cam{k}") for k, camera in enumerate(camera_arc(2), 1))
    write_cameras(folder / "calibration.toml", [one, two], 0.0, {})
    write_cameras(folder / "camera.toml", [one], 0.0, {})
    for name, camera in {"walk": one, "one": one, "two": two}.items():
        write_video(folder / f"{name}.mp4", [np.full((camera.height, camera.width, 3), 90, np.uint8)] * N)
    pixels = {name: camera.project(walker_joints()[:N]) for name, camera in (("one", one), ("two", two))}
    for name, joints in pixels.items():
        people = [[points(_LAYOUT, dict(zip(JOINT_NAMES, frame, strict=True)))] for frame in joints.tolist()]
        write(folder / f"{name}_json", dict(enumerate(people)))
    rows = [f"{t},{joint},{u:.2f},{v:.2f},1" for t, frame in enumerate(pixels["one"])
            for joint, (u, v) in zip(JOINT_NAMES, frame, strict=True)]  # fmt: skip
    for name in ("annotations", "joints"):
        (folder / f"{name}.csv").write_text("\n".join(["frame,joint,u,v,visible", *rows, ""]))
    _boards(folder)
    (folder / "points").mkdir()
    for frame in Points(n_frames=N, n_points=120).frames():
        np.savetxt(folder / "points" / f"{frame.index}.csv", frame.points, delimiter=",", header="x,y,z", comments="")
    motion = find_motion("builtin", data=None, rate_hz=30.0)
    for name in ("clips/dataset-1_walk_normal_001", "my_walk"):
        write_bandai_like(folder / f"{name}.bvh", motion)


def _boards(folder):
    left = lens("cam1")
    for number, camera in enumerate((left, replace(left, name="cam2", translation=np.array([-0.1, 0.0, 0.0]))), 1):
        write_video(folder / f"board{number}.mp4", [rendered(camera, *pose) for pose in board_poses(7)])


def write_video(path, images):
    """Write images (height, width, 3) as a video of 10 frames a second."""
    height, width = images[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, (width, height))
    for image in images:
        video.write(image)
    video.release()


ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
RENDERED = ("dataset.width=80", "dataset.height=60", "dataset.person_px=40", "dataset.focal_px=90")
SMALLER = {  # pattern: replacement in a command line
    r"\b(inference\.n_particles)=\d+\b(?!,)": r"\1=20", "n_particles=500,5000": "n_particles=20",
    r"range\((5|20)\)": "range(1)", r"range\(10\)": "range(2)", "seed=0,1,2": "seed=0,1",
    "n_trials=20": "n_trials=2", "n_jobs=8": "n_jobs=1", "9x6": CORNERS, "floor 120": "floor 3",
    "motions=recorded": "motions=builtin",
    "square-mm 25": f"square-mm {SQUARE_MM}", "recordings/baselines": "baselines",
    r"-o (camera|calibration)\.toml": r"-o made_\1.toml", r"/13\b": "/1",
}  # fmt: skip
ELSEWHERE = {  # part of a command that does not run here: the test that runs it
    "python3 -m venv": ".ci/run", "pip install": ".ci/run", "submitit_slurm": "test_slurm.py",
    "pytest --pyargs": "test_own_components.py", "pytest -m slow": ".ci/run",
    "my/experiment": "test_own_experiments.py",
    "--config-dir": "test_own_experiments.py", "--against": "test_check.py", "git bisect": "test_check.py",
    "python -m analysis": "tests/unit/analysis", "analysis.benchmarks": "analysis/benchmarks, by hand",
    "my_components": "test_own_components.py", "pytest test_still.py": "test_own_components.py",
    "humaneva_": "test_humaneva_experiments.py",
    "rm status=failed": "tests/unit/cli/test_runs.py", "workbench detect": "tests/unit/cli/test_detect.py",
    "workbench track": "tests/real_data/test_own_video_page.py",
}  # fmt: skip
EXTRAS = {
    "joblib": "hydra_plugins.hydra_joblib_launcher", "optuna": "hydra_plugins.hydra_optuna_sweeper",
}  # fmt: skip
PAGES = [
    page for page in sorted([ROOT / "README.md", *DOCS.rglob("*.md")])
    if not {"_generated", "_tables"} & {*page.parts}
    and page.name != "tutorial.md"  # see test_documents.py
]  # fmt: skip


def command_lines(page):
    """Yield the command lines of a page's shell blocks that run here."""
    for block in re.findall(r"```sh\n(.+?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            if line.strip() and not line.startswith("#") and not any(part in line for part in ELSEWHERE):
                yield line


def small_command(line, folder):
    """Return the words of a command line as a shell expands them, with the overrides of a small run."""
    for pattern, replacement in SMALLER.items():
        line = re.sub(pattern, replacement, line)
    shell = ["bash", "-euc", f"printf '%s\\0' {line}"]
    words = subprocess.run(shell, cwd=folder, capture_output=True, text=True, check=True).stdout.split("\0")[:-1]
    return words + _small(words) if words[1] == "run" else words


def _small(words):
    """Return overrides for few frames, particles and pixels that suit a command."""
    if any(word.startswith(("from=", "--")) for word in words):
        return []
    text = " ".join(words)
    chosen = re.search(r"dataset=(\w+)", text)
    small = ["dataset.n_frames=4"]
    small += ["dataset.scale=0.25"] if "walk_video" in text else list(RENDERED) * (chosen is None)
    small += ["training.motions=builtin"] * ("paths.data=" in text and "training.motions" not in text)
    small += ["dataset.motion=builtin"] * ("walk_multi_cue" in text)
    no_particles = re.search(r"inference\.n_particles|least_squares|synthesis", text)
    small += ["inference.n_particles=20"] * (no_particles is None)
    return small


@pytest.fixture(scope="module")
def folder(tmp_path_factory, cache):
    """Return a folder with a user's files, a run and a sweep of two runs, with the names that the pages use."""
    folder = tmp_path_factory.mktemp("pages")
    write_own_files(folder)
    small = [*RENDERED, "dataset.n_frames=4", "inference.n_particles=20"]
    for sweep in (["hydra.run.dir=recordings/runs/walk_circle/TIME", "experiment=walk_circle"],
                  ["-m", "experiment=walk_straight", "seed=0,1",
                   "hydra.sweep.dir=recordings/sweeps/walk_straight/TIME"]):  # fmt: skip
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            patch.setenv("WORKBENCH_CACHE", str(cache))
            patch.delenv("WORKBENCH_DATA", raising=False)
            assert not main(["run", *sweep, *small])
        GlobalHydra.instance().clear()
    runs = [folder / "recordings/sweeps/walk_straight/TIME" / job / "run.rrd" for job in "01"]
    for name, run in {"A": runs[0], "B": runs[1], "a": runs[0], "b": runs[0], "mine": runs[0], "run": runs[0]}.items():
        shutil.copy(run, folder / f"{name}.rrd")
    (folder / "out").mkdir()
    shutil.copy(runs[0], folder / "out" / "run.rrd")
    (folder / "baselines").mkdir()
    shutil.copy(runs[0], folder / "baselines" / "walk_straight.rrd")
    return folder


@pytest.fixture
def call(folder, cache, monkeypatch, request, trusted):
    """Return a function that runs the words of a command in the folder and returns the exit code.

    Commands run in this process, which saves the imports; those with Hydra's plugins, which change global state, run in
    a subprocess."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    monkeypatch.setattr("workbench.cli.view.viewer", lambda: Path(shutil.which("true")))  # returns immediately
    monkeypatch.setattr("workbench.cli.annotate.serve", lambda server: None)  # returns immediately
    monkeypatch.setattr("workbench.cli.annotate.webbrowser.open", lambda url: True)

    def command(words):
        if "paths.data=DATA" in words:
            data = request.getfixturevalue("data")
            words = [f"paths.data={data}" if word == "paths.data=DATA" else word for word in words]
        if any(word.startswith("hydra/") for word in words):
            return subprocess.run([sys.executable, "-m", *words], check=False).returncode
        try:
            return main(words[1:])
        except SystemExit as end:
            return end.code
        finally:
            GlobalHydra.instance().clear()

    return command


COMMANDS = [(page, line) for page in PAGES for line in command_lines(page)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "line"), COMMANDS, ids=lambda part: " ".join(getattr(part, "name", part).split())[:80]
)
def test_a_documented_command_runs(call, folder, page, line, capfd):
    for word, module in EXTRAS.items():
        if word in line:
            pytest.importorskip(module)
    code = call(small_command(line, folder))
    output = "".join(capfd.readouterr())
    assert code == 0, output
    assert "Traceback" not in output
