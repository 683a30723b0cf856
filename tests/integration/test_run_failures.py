"""Runs whose folder is in use, whose disk is full or whose process is killed lose no recorded frame."""

import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import termios
import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from workbench.recording.read.reader import read
from workbench.recording.write import recorder
from workbench.utils.run_files import EARLIER, LOCK
from workbench.utils.run_lock import run_folder

SMALL = ("dataset.n_frames=4", "inference.n_particles=60", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175", "experiment=walk_straight")
N_FRAMES = 60
LONG = (f"dataset.n_frames={N_FRAMES}", "inference.n_particles=2000", *SMALL[2:])
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
MAX_LOST = 2
"""Largest number of frames that the progress bar shows and the recording lacks."""


def test_the_folder_of_a_running_run_is_refused_and_unchanged(run, tmp_path):
    with run_folder(tmp_path / "out"):
        code, output, folder = run("out", *SMALL)
        assert code == 2
        assert f"out: process {os.getpid()} on " in output
        assert [path.name for path in folder.iterdir()] == [LOCK]


@pytest.mark.slow
def test_a_complete_run_is_moved_and_not_overwritten_in_a_folder_of_any_name(run):
    name = "Läufe mit Abstand/日本 (2), it's"
    code, output, folder = run(name, *SMALL)
    assert code == 0, output
    recording = (folder / "run.rrd").read_bytes()
    code, output, _ = run(name, f"from={folder / 'run.rrd'}", "seed=1")
    assert code == 2
    assert f"{folder.name}: contains the run to repeat" in output
    code, output, _ = run(name, "seed=1", *SMALL)
    assert code == 0
    assert "the complete run in it was moved to" in output
    assert (folder / EARLIER / "1" / "run.rrd").read_bytes() == recording
    assert json.loads((folder / EARLIER / "1" / "summary.json").read_text())["seed"] == 0
    assert read(folder / "run.rrd").settings["seed"] == 1


def start(folder, *overrides, **environment):
    """Start the command in a subprocess with piped output."""
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", **environment}
    environment.pop("WORKBENCH_DATA", None)
    command = [sys.executable, "-m", "workbench", "run", *SMALL, f"hydra.run.dir={folder}", *overrides]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, cwd=folder.parent, env=environment, **pipes)


@pytest.mark.slow
def test_of_two_simultaneous_runs_in_one_folder_one_completes_and_one_is_refused(tmp_path, cache):
    both = [start(tmp_path / "out", f"seed={k}", WORKBENCH_CACHE=str(cache)) for k in range(2)]
    outputs = [process.communicate(timeout=120)[0] for process in both]
    assert sorted(process.returncode for process in both) == [0, 2], outputs
    complete, refused = sorted(range(2), key=lambda k: both[k].returncode)
    assert f"out: process {both[complete].pid} on " in outputs[refused]
    assert read(tmp_path / "out" / "run.rrd").settings["seed"] == complete
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["seed"] == complete


@pytest.fixture
def file_size_limit():
    """Limit the files that this process writes to 800 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (800_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.slow
def test_a_full_disk_ends_the_run_with_a_readable_part(run, monkeypatch, file_size_limit):
    monkeypatch.setattr(recorder, "FLUSH_S", np.inf)
    monkeypatch.setattr(recorder, "MAX_FLUSH_EVERY", 3)
    code, output, folder = run("out", *SMALL)
    assert code == 1, output
    assert "Traceback" not in output
    assert "out/run.rrd.part: " in output.splitlines()[-1]
    assert "left for it on the disk" in output.splitlines()[-1]
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["status"], "left for it on the disk" in summary["error"]) == ("failed", True)
    assert len(read(folder / "run.rrd.part").poses[0]) == 3


def run_in_terminal(folder, cache, number=signal.SIGKILL, after_s=300.0):
    """Run in a pseudo-terminal and send a signal after some seconds; return exit code, output and duration in s."""
    begun, output, (terminal, slave) = time.monotonic(), b"", pty.openpty()
    termios.tcsetwinsize(slave, (24, 200))  # without a width no progress bar is drawn
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache), "NUMBA_NUM_THREADS": "1"}
    environment.pop("WORKBENCH_DATA", None)
    command = [sys.executable, "-m", "workbench", "run", *LONG, f"hydra.run.dir={folder}"]
    streams = {"stdin": slave, "stdout": slave, "stderr": slave, "start_new_session": True}
    with subprocess.Popen(command, env=environment, cwd=folder.parent, **streams) as process:
        os.close(slave)
        timer = threading.Timer(after_s, process.send_signal, [number])
        timer.start()
        with suppress(OSError):  # the process has closed its end
            while more := os.read(terminal, 65536):
                output += more
    timer.cancel()
    os.close(terminal)
    return process.returncode, output.decode("utf-8", "replace"), time.monotonic() - begun


def assert_nothing_is_lost(folder, number, code, output):
    """Check that run.rrd is complete, or that run.rrd.part has all frames of the progress bar but the last ones."""
    recording, part, summary = (folder / name for name in ("run.rrd", "run.rrd.part", "summary.json"))
    bar = "".join(line for line in output.splitlines() if "rendering" not in line)
    n_shown = max(map(int, re.findall(rf"(\d+)/{N_FRAMES} \[", bar)), default=0)
    content = json.loads(summary.read_text()) if summary.is_file() else {"status": None, "metrics": {}}
    status, n_recorded = content["status"], int(content["metrics"].get("n_frames", 0))
    killed, published = number == signal.SIGKILL, recording.is_file()
    rates_hz = [float(rate) for rate in re.findall(r"([\d.]+)frame/s", bar)]
    max_lost = MAX_LOST + (int(1.5 * max(rates_hz, default=0.0)) if killed else 0)  # written once a second
    if published or n_shown > max_lost:
        run = read(recording if published else part)
        n_readable = len(run.poses[0])
        assert n_readable >= max(n_shown - max_lost, n_recorded)
        assert killed or n_readable == n_recorded
        assert not published or (run.status, n_readable) == ("complete", N_FRAMES)
    unfinished = "running" if killed else "interrupted"
    assert status in (("complete", "running" if killed else "complete") if published else (None, unfinished))
    unhandled = status is None or published  # before the handlers are installed, or after the run
    assert code in ((-number, 0) if killed else (128 + number, 0)) or (unhandled and code == -number)
    assert published or code != 0
    assert unhandled or "Traceback" not in output


@pytest.mark.slow
def test_a_run_ended_by_a_signal_at_any_time_loses_nothing(tmp_path):
    """Each signal is sent once, or $WORKBENCH_CASES signals; every fifth run has an empty cache."""
    rng, warm = np.random.default_rng(7), tmp_path / "cache"
    code, _, longest_s = run_in_terminal(tmp_path / "first", warm)
    assert code == 0
    for k in range(int(os.environ.get("WORKBENCH_CASES", "4"))):
        number, folder = SIGNALS[k % 4], tmp_path / str(k)
        cache = tmp_path / f"cache {k}" if k % 5 == 4 else warm
        code, output, _ = run_in_terminal(folder, cache, number, rng.uniform(0.0, longest_s))
        assert_nothing_is_lost(folder, number, code, output)
    assert run_in_terminal(tmp_path / "last", warm)[0] == 0
    np.testing.assert_array_equal(*(read(tmp_path / name / "run.rrd").poses[1] for name in ("first", "last")))
