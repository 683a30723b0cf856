"""What becomes of runs when folders are crowded, disks full, viewers stuck and processes killed."""

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
from workbench.utils.run_files import EARLIER, LOCK
from workbench.utils.run_lock import run_folder

SMALL = ("dataset.n_frames=4", "inference.n_particles=60", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175", "experiment=walk_straight")
N_FRAMES = 60
LONG = (f"dataset.n_frames={N_FRAMES}", "inference.n_particles=4000", *SMALL[2:])
WAYS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
MOST_LOST = 2
"""Frames that were shown as done and are not on the disk."""


def test_the_folder_of_another_run_is_refused_before_anything_is_written(run, tmp_path):
    with run_folder(tmp_path / "out"):
        code, told, folder = run("out", *SMALL)
        assert code == 2
        assert f"out: process {os.getpid()} on " in told
        assert [path.name for path in folder.iterdir()] == [LOCK]


@pytest.mark.slow
def test_a_complete_run_is_not_overwritten(run):
    _, _, folder = run("out", *SMALL)
    kept = (folder / "run.rrd").read_bytes()
    code, told, _ = run("out", "seed=1", *SMALL)
    assert code == 0
    assert "the complete run in it was moved to" in told
    assert (folder / EARLIER / "1" / "run.rrd").read_bytes() == kept
    assert json.loads((folder / EARLIER / "1" / "summary.json").read_text())["seed"] == 0
    assert read(folder / "run.rrd").settings["seed"] == 1
    code, told, _ = run("out", f"from={folder / 'run.rrd'}@2")
    assert code == 2
    assert "out: contains the run to resume" in told


@pytest.mark.slow
def test_a_folder_may_have_any_name(run):
    name = "Läufe mit Abstand/日本 (2), it's"
    code, told, folder = run(name, *SMALL)
    assert code == 0, told
    assert read(folder / "run.rrd").status == "complete"
    code, told, _ = run("Läufe mit Abstand/weiter", f"from={folder / 'run.rrd'}@2")
    assert code == 0, told


def started(folder, *overrides, limit=None, **environment):
    """Start the command as a process of its own, its output piped; limit: called in it first."""
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", **environment}
    environment.pop("WORKBENCH_DATA", None)
    command = [sys.executable, "-m", "workbench", "run", *SMALL, f"hydra.run.dir={folder}", *overrides]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, cwd=folder.parent, env=environment, preexec_fn=limit, **piped)


@pytest.mark.slow
def test_of_two_runs_at_once_in_one_folder_one_ends_well_and_the_other_is_told(tmp_path, cache):
    both = [started(tmp_path / "out", f"seed={k}", WORKBENCH_CACHE=str(cache)) for k in range(2)]
    told = [process.communicate(timeout=120)[0] for process in both]
    assert sorted(process.returncode for process in both) == [0, 2], told
    well, refused = sorted(range(2), key=lambda k: both[k].returncode)
    assert f"out: process {both[well].pid} on " in told[refused]
    assert read(tmp_path / "out" / "run.rrd").settings["seed"] == well
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["seed"] == well


def limited_to(n_bytes):
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))


@pytest.mark.slow
def test_a_recording_that_may_not_grow_ends_the_run_with_what_fits(tmp_path, cache):
    given = {"WORKBENCH_CACHE": str(cache), "limit": limited_to(800_000)}
    with started(tmp_path / "out", "dataset.n_frames=40", **given) as process:
        told = process.communicate(timeout=120)[0]
    assert process.returncode == 1, told
    assert "Traceback" not in told
    assert "out/run.rrd.part: " in told.splitlines()[-1]
    assert "left for it on the disk" in told.splitlines()[-1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["status"], "left for it on the disk" in summary["error"]) == ("failed", True)
    assert len(read(tmp_path / "out" / "run.rrd.part").poses[0]) >= 3


def at_a_terminal(folder, cache, way=signal.SIGKILL, after_s=300.0):
    """Run at a terminal of its own, with a signal after some seconds: exit code, what was shown, seconds it took."""
    begun, shown, (terminal, own) = time.monotonic(), b"", pty.openpty()
    termios.tcsetwinsize(own, (24, 200))  # in one of no width no bar is drawn
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache), "NUMBA_NUM_THREADS": "1"}
    environment.pop("WORKBENCH_DATA", None)
    command = [sys.executable, "-m", "workbench", "run", *LONG, f"hydra.run.dir={folder}"]
    ends = {"stdin": own, "stdout": own, "stderr": own, "start_new_session": True}
    with subprocess.Popen(command, env=environment, cwd=folder.parent, **ends) as process:
        os.close(own)
        timer = threading.Timer(after_s, process.send_signal, [way])
        timer.start()
        with suppress(OSError):  # as when its other end is closed
            while more := os.read(terminal, 65536):
                shown += more
    timer.cancel()
    os.close(terminal)
    return process.returncode, shown.decode("utf-8", "replace"), time.monotonic() - begun


def assert_nothing_is_lost(folder, way, code, shown):
    """What is published is whole; what is not can be read but for the last frames that were shown as done."""
    whole, part, summary = (folder / name for name in ("run.rrd", "run.rrd.part", "summary.json"))
    bar = "".join(line for line in shown.splitlines() if "rendering" not in line)
    n_shown = max(map(int, re.findall(rf"(\d+)/{N_FRAMES} \[", bar)), default=0)
    status = json.loads(summary.read_text())["status"] if summary.is_file() else None
    killed, published = way == signal.SIGKILL, whole.is_file()
    rates_hz = [float(rate) for rate in re.findall(r"([\d.]+)frame/s", bar)]
    most_lost = MOST_LOST + (int(1.5 * max(rates_hz, default=0.0)) if killed else 0)  # the frames of a second
    if published or n_shown > most_lost:
        run = read(whole if published else part)
        assert len(run.poses[0]) >= n_shown - most_lost
        assert not published or (run.status, len(run.poses[0])) == ("complete", N_FRAMES)
    unfinished = "running" if killed else "interrupted"
    assert status in (("complete", "running" if killed else "complete") if published else (None, unfinished))
    by_itself = status is None or published  # before Python hears of signals, and when all is over
    assert code in ((-way, 0) if killed else (128 + way, 0)) or (by_itself and code == -way)
    assert published or code != 0
    assert by_itself or "Traceback" not in shown


@pytest.mark.slow
def test_runs_that_a_signal_ends_at_any_time_lose_nothing(tmp_path, run):
    """One of each signal; $WORKBENCH_CASES of them instead, where that says how many; every fifth finds no cache."""
    rng, warm = np.random.default_rng(7), tmp_path / "cache"
    assert run("quiet", *LONG, within=tmp_path).code == 0  # which compiles
    code, _, longest_s = at_a_terminal(tmp_path / "quieter", warm)
    assert code == 0
    for k in range(int(os.environ.get("WORKBENCH_CASES", "4"))):
        way, folder = WAYS[k % 4], tmp_path / str(k)
        cache = tmp_path / f"cache {k}" if k % 5 == 4 else warm
        code, shown, _ = at_a_terminal(folder, cache, way, rng.uniform(0.0, longest_s))
        assert_nothing_is_lost(folder, way, code, shown)
    assert at_a_terminal(tmp_path / "last", warm)[0] == 0
    np.testing.assert_array_equal(*(read(tmp_path / name / "run.rrd").poses[1] for name in ("last", "quiet")))
