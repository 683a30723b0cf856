"""What another process compiles is waited for, taken as it left it, and compiled here where it fails."""

import importlib
import json
import os
import subprocess
import sys
from subprocess import Popen

import numba
import pytest

from workbench import compiled_beside, kernel_cache

MODULE = """
import numba

@numba.njit(cache=True)
def twice(x):
    return 2 * x
"""


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A module with a kernel `twice`, none of which is kept yet, and a way to have another process run a line."""
    (tmp_path / "compiled_elsewhere.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(compiled_beside, "_beside", {})
    compiled_beside.wait_for_kernels()
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": str(tmp_path)}

    def begin(line):
        process = Popen([sys.executable, "-c", line], env=environment)
        compiled_beside._beside["compiled_elsewhere.twice"] = process
        return process

    yield importlib.import_module("compiled_elsewhere").twice, begin
    del sys.modules["compiled_elsewhere"]


def test_a_kernel_that_another_process_compiles_is_waited_for_and_not_compiled(elsewhere):
    twice, begin = elsewhere
    process = begin("import time, compiled_elsewhere as c; time.sleep(0.5); c.twice(1); time.sleep(60)")
    assert twice(4) == 8
    assert sum(twice.stats.cache_hits.values()) == 1
    assert process.poll() is None  # it was not waited for longer than needed
    process.kill()
    process.wait()


def test_what_the_last_thing_of_a_process_was_is_found_too(elsewhere):
    twice, begin = elsewhere
    begin("import compiled_elsewhere as c; c.twice(1)").wait()
    assert twice(4) == 8
    assert sum(twice.stats.cache_hits.values()) == 1


def test_where_the_other_process_fails_the_kernel_is_compiled_here_and_that_is_told(elsewhere, caplog):
    twice, begin = elsewhere
    begin("raise SystemExit(3)")
    assert twice(4) == 8
    assert sum(twice.stats.cache_hits.values()) == 0
    assert caplog.messages == ["compiled_elsewhere.twice is compiled here: the process that was to do so ended with 3"]


def test_what_was_compiled_for_something_else_is_compiled_here_without_a_word(elsewhere, caplog):
    twice, begin = elsewhere
    begin("import compiled_elsewhere as c; c.twice(1)").wait()
    assert twice(0.5) == 1.0
    assert caplog.messages == []


def test_the_other_process_waits_for_what_its_own_module_has_others_compile(tmp_path):
    """Python runs a copy of the module by `-m`, beside that which kernels import."""
    told = "from numba.core.caching import Cache\n\ndef compile_ahead():\n    print(Cache.load_overload.__module__)\n"
    (tmp_path / "telling.py").write_text(told)
    command = [sys.executable, "-P", "-m", "workbench.compiled_beside", "telling"]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(tmp_path)}, check=True, stdout=-1, text=True)
    assert done.stdout.split() == ["workbench.compiled_beside"]


@pytest.fixture
def started(monkeypatch, tmp_path):
    """The commands of the processes that are started, none of which is."""
    commands = []

    class Started:
        def __init__(self, command, **_):
            commands.append(command[1:])

        def kill(self):
            pass

        wait = kill

    monkeypatch.setattr(compiled_beside, "Popen", Started)
    monkeypatch.setattr(compiled_beside, "_beside", {})
    monkeypatch.setattr(kernel_cache, "_in_use", tmp_path)
    return commands


def test_nothing_is_started_for_kernels_that_are_kept_or_begun(started, tmp_path):
    compiled_beside.compile_beside("workbench.body.some", "one", "two", by="workbench.body.other")
    compiled_beside.compile_beside("workbench.body.some", "two")
    assert started == [["-P", "-m", "workbench.compiled_beside", "workbench.body.other"]]
    (tmp_path / "body_0123").mkdir()
    for name in ("three", "four"):
        (tmp_path / "body_0123" / f"some.{name}-17.py311.nbi").touch()
    compiled_beside.compile_beside("workbench.body.some", "three", "four")
    assert len(started) == 1
    compiled_beside.compile_beside("workbench.body.some", "three", "five")  # of which one is not kept
    assert len(started) == 2


RUN = """
import sys
from workbench import api
from workbench.experiment import compiling_ahead
if sys.argv[1] == "alone":
    compiling_ahead.compile_beside = lambda *_, **__: None
if __name__ == "__main__":
    api.run("walk_straight", *sys.argv[3:], "dataset.n_frames=3", folder=sys.argv[2])
"""
MOTION = ["kernel._pack", "kernel._run", "patches.patch", "patches.cover", "patches.mark_hidden"]
ALIGNMENT = ["kernel.place_points", "layers._draw_all", "layers._log_ratios"]
ALIGNMENT += [f"kernels.{name}" for name in ("place", "see", "place_beside", "turn_axes", "add_normal")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ahead", "keys"),
    [
        (MOTION, ["inference.n_particles=64"]),
        (["kernel.place_points"], ["inference.n_particles=64", "likelihood=edges"]),
        (ALIGNMENT, ["prior=smooth", "likelihood=alignment", "inference=kalman"]),
    ],
)
def test_what_is_compiled_ahead_is_what_a_run_calls_and_comes_to_the_same_bits(tmp_path, ahead, keys):
    """It is compiled once, for a run's types; what is kept of its helpers is as if they were compiled with it."""
    found = {}
    for way in ("beside", "alone"):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / way)}
        command = [sys.executable, "-c", RUN, way, str(tmp_path / f"run_{way}"), *keys]
        subprocess.run(command, env=environment, check=True, capture_output=True)
        kept = [path.name.partition("-")[0] for path in (tmp_path / way).rglob("*.nbc")]
        assert [kept.count(kernel) for kernel in ahead] == [1] * len(ahead)
        found[way] = _results(tmp_path / f"run_{way}")
    assert found["beside"] == found["alone"]


def _results(folder):
    """The numbers of a run to the last bit, but for its times."""
    metrics = json.loads((folder / "summary.json").read_text())["metrics"]
    assert metrics["error_px"] > 0.0
    return {name: value for name, value in metrics.items() if name not in ("seconds", "ms_per_frame", "compiling_s")}
