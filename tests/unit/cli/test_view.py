"""`workbench view` opens recordings in the viewer, names the runs of a sweep, and reports unreadable files."""

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
    """A stub of the viewer with its exit code, and its options, files and {recording id: name} of its last call."""
    viewer = SimpleNamespace(code=0)

    def show(command, files):
        viewer.options, viewer.files = command[1:], list(files)
        viewer.names = {}
        for path in viewer.files:
            store = RrdReader(path).recordings()[0]
            for chunk in RrdReader(path).stream().filter(content="/__properties"):
                batch = chunk.to_record_batch()
                if "RecordingInfo:name" in batch.schema.names:
                    key = (store.application_id, store.recording_id)
                    viewer.names[key] = batch.column("RecordingInfo:name").to_pylist()[0][0]
        return viewer.code

    monkeypatch.setattr(view, "show", show)
    return viewer


def test_one_recording_is_opened_unchanged(sweep, viewer):
    assert main(["view", str(sweep / "1")]) == 0
    assert viewer.files == [sweep / "1" / "run.rrd"]
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
def test_runs_of_a_sweep_are_named_by_their_varied_keys(sweep, viewer):
    assert main(["view", str(sweep)]) == 0
    jobs = {}
    for k, name in enumerate(["run.rrd", "run.rrd", "run.rrd", "run.rrd.part"]):
        store = RrdReader(sweep / str(k) / name).recordings()[0]
        jobs[store.application_id, store.recording_id] = k
    assert {jobs.get(key): name for key, name in viewer.names.items()} == {
        0: "n_particles=20, seed=0",
        1: "n_particles=20, seed=1",
        2: "n_particles=30, seed=0",
        3: "n_particles=30, seed=1, failed",
        None: "all runs: errors and outcomes",
    }
    assert len({application for application, _ in jobs}) == 4  # an application per layout
    assert not any(path.exists() for path in viewer.files[4:])  # names are temporary files


def test_several_files_are_piped_to_the_viewer_without_their_incomplete_messages(sweep, tmp_path):
    program = tmp_path / "viewer"
    program.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/arguments\ncat > {tmp_path}/stdin\nexit 3\n')
    program.chmod(0o755)
    content = (sweep / "0" / "run.rrd").read_bytes()
    (tmp_path / "cut.rrd.part").write_bytes(content[:-7])
    assert view.show([str(program), "--bind"], [tmp_path / "cut.rrd.part", sweep / "1" / "run.rrd"]) == 3
    assert (tmp_path / "arguments").read_text() == "--bind -\n"
    first, _, last = (tmp_path / "stdin").read_bytes().partition((sweep / "1" / "run.rrd").read_bytes())
    assert last == b""
    assert 0 < len(first) < len(content) - 7
    assert content.startswith(first)


@pytest.mark.slow
def test_the_page_for_a_browser_is_served_locally(sweep):
    """The recordings of the sweep are piped to the server."""
    command = [sys.executable, "-m", "workbench", "view", "--web", str(sweep)]
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


def test_two_recordings_are_shown_side_by_side_in_their_order(sweep, tmp_path, monkeypatch, capsys):
    first, second, copy = sweep / "2" / "run.rrd", sweep / "0" / "run.rrd", tmp_path / "both.rrd"
    monkeypatch.setattr(view, "show", lambda command, files: shutil.copy(*files, copy) and 0)
    assert main(["view", str(first), str(second)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"a: {first} (n_particles=30)", f"b: {second} (n_particles=20)"]
    entities = {chunk.entity_path for chunk in RrdReader(copy).stream()}
    assert {"/a/metrics/mpjpe_abs_mm", "/b/metrics/mpjpe_abs_mm", "/a/world/camera/image"} <= entities


def test_unreadable_and_repeated_recordings_are_omitted_with_a_message(sweep, viewer, tmp_path, capsys):
    valid = Path(shutil.copy(sweep / "0" / "run.rrd", tmp_path / "a.rrd"))
    shutil.copy(valid, tmp_path / "same.rrd")
    (tmp_path / "junk.rrd").write_bytes(b"no recording")
    record(tmp_path / "odd.rrd", seed=5, config="- a list")
    assert main(["view", str(tmp_path)]) == 0
    assert viewer.files == [valid]
    messages = capsys.readouterr().err.splitlines()
    assert len(messages) == 3
    for name in ("same.rrd", "junk.rrd", "odd.rrd"):
        assert sum(str(tmp_path / name) in message for message in messages) == 1
