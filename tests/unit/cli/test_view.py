"""`workbench view` opens one recording, or two named by their differences, and reports unreadable files."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from time import sleep
from types import SimpleNamespace
from urllib.error import URLError
from urllib.request import urlopen

import pytest
import yaml
from recording_steps import BODY, SPACE, steps
from rerun.chunk import RrdReader

from workbench.cli import view
from workbench.cli.main import main
from workbench.recording.write.recorder import Recorder

N_FRAMES = 2


def record(path, seed=0, n_particles=20, crash=False, config=None):
    settings = {"inference": {"n_particles": n_particles}, "seed": seed}
    text = yaml.safe_dump(settings) if config is None else config
    labels = {"config_yaml": text, "provenance": {"experiment": "walk", "seed": seed}}
    try:
        with Recorder(path, BODY, SPACE, run_id=f"{n_particles}-{seed}-{crash}", **labels) as recorder:
            for step in steps(N_FRAMES, n_particles=n_particles, seed=seed):
                recorder.log(step, {"mpjpe_abs_mm": 1.0})
            if crash:
                raise RuntimeError("crash")
    except RuntimeError:
        return path.with_name(path.name + ".part")
    return path


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    for k, (seed, n_particles) in enumerate([(0, 20), (1, 20), (0, 30)]):
        record(folder / str(k) / "run.rrd", seed, n_particles)
    record(folder / "3" / "run.rrd", 1, 30, crash=True)
    return folder


@pytest.fixture
def viewer(monkeypatch):
    """A stub of the viewer with its exit code, its command, and the entities of the recording of its last call."""
    viewer = SimpleNamespace(code=0)

    def run(command):
        viewer.options, viewer.path = command[1:-1], Path(command[-1])
        viewer.entities = {chunk.entity_path for chunk in RrdReader(viewer.path).stream()}
        return SimpleNamespace(returncode=viewer.code)

    monkeypatch.setattr(view, "processes", SimpleNamespace(run=run))
    return viewer


def test_one_recording_is_opened_unchanged(sweep, viewer):
    assert main(["view", str(sweep / "1")]) == 0
    assert viewer.path == sweep / "1" / "run.rrd"
    assert viewer.options == ["--bind", "127.0.0.1", "--port", "auto"]  # a new viewer, reachable from this machine only


@pytest.mark.parametrize(("display", "hint"), [("", True), (":0", False)])
def test_without_a_display_the_browser_is_suggested(sweep, viewer, monkeypatch, capsys, display, hint):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setattr("sys.platform", "linux")
    viewer.code = 1
    assert main(["view", str(sweep / "1")]) == 1
    assert ("there is no display: --web" in capsys.readouterr().err) == hint


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.parametrize(
    ("jobs", "expected"),
    [("20", ["n_particles=30", "n_particles=20"]), ("01", ["walk, seed=0", "walk, seed=1"]),
     ("13", ["n_particles=20", "n_particles=30, failed"])],
)  # fmt: skip
def test_two_recordings_are_shown_side_by_side_in_their_order(sweep, viewer, capsys, jobs, expected):
    """They are named by their differences, also where one is of a failed run."""
    files = [next((sweep / job).glob("run.rrd*")) for job in jobs]
    for places in (files, [sweep / job for job in jobs]):
        assert main(["view", *map(str, places)]) == 0
        lines = [f"{side}: {path} ({name})" for side, path, name in zip("ab", files, expected, strict=True)]
        assert capsys.readouterr().out.splitlines() == lines
        assert {"/a/metrics/mpjpe_abs_mm", "/b/metrics/mpjpe_abs_mm", "/a/world/camera/image"} <= viewer.entities
        assert not viewer.path.exists()  # a temporary file


def test_more_than_two_recordings_are_refused(sweep, viewer, capsys):
    assert main(["view", str(sweep)]) == 2
    message = f"{sweep}: expected one or two recordings, found 4; workbench report compares many"
    assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_the_page_for_a_browser_is_served_locally(sweep):
    command = [sys.executable, "-m", "workbench", "view", "--web", str(sweep / "0")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        address = next(line.split()[1] for line in process.stdout if line.startswith("open "))
        forward = process.stdout.readline()
        page = address.partition("/?")[0]
        try:
            for _ in range(100):
                with suppress(URLError), urlopen(page, timeout=10) as answer:
                    assert answer.status == 200
                    assert b"<html" in answer.read().lower()
                    break
                sleep(0.2)
            else:
                pytest.fail("no answer")
        finally:
            os.killpg(process.pid, signal.SIGTERM)
    assert page.startswith("http://127.0.0.1:")
    port = page.rpartition(":")[2]
    assert f"ssh -L {port}:127.0.0.1:{port} " in forward


def test_unreadable_and_repeated_recordings_are_omitted_with_a_message(sweep, viewer, tmp_path, capsys):
    valid = Path(shutil.copy(sweep / "0" / "run.rrd", tmp_path / "a.rrd"))
    shutil.copy(valid, tmp_path / "same.rrd")
    (tmp_path / "junk.rrd").write_bytes(b"no recording")
    record(tmp_path / "odd.rrd", seed=5, config="- a list")
    assert main(["view", str(tmp_path)]) == 0
    assert viewer.path == valid
    messages = capsys.readouterr().err.splitlines()
    assert len(messages) == 3
    for name in ("same.rrd", "junk.rrd", "odd.rrd"):
        assert sum(str(tmp_path / name) in message for message in messages) == 1
