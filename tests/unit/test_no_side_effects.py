"""Importing the workbench, and a run inside another application, leave the process unchanged."""

import os
import subprocess
import sys

import pytest

import workbench as wb
from workbench.cli.run import run

STATE = """
import gc, os, signal, sys

def state():
    handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
    return dict(os.environ), handlers, gc.get_threshold(), sys.excepthook
"""


def python(code, folder):
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


MODULES = (
    "workbench", "workbench.api", "workbench.cli.main", "workbench.cli.run", "workbench.recording.write.recorder",
    "workbench.sweep.plan",
)  # fmt: skip


@pytest.mark.slow
def test_imports_change_nothing_in_the_process(tmp_path):
    imports = "".join(f"import {name}\nassert state() == before, {name!r}\n" for name in MODULES)
    python(f"{STATE}\nimport hydra, numba, omegaconf, rerun, cv2\nbefore = state()\n{imports}", tmp_path)


@pytest.mark.slow
def test_no_attribute_of_another_package_is_replaced(tmp_path):
    """Functions of these packages' classes and modules are the same objects before and after a run."""
    code = """
import inspect, sys
import hydra.core.plugins, hydra._internal.hydra, numba, numba.core.caching, numba.core.event, omegaconf, rerun

PACKAGES = ("hydra", "numba", "omegaconf", "submitit")

def functions_of_packages():
    modules = [module for name, module in [*sys.modules.items()] if name.partition(".")[0] in PACKAGES]
    classes = {value for module in modules for value in vars(module).values() if inspect.isclass(value)
               and value.__module__.partition(".")[0] in PACKAGES}
    functions = {}
    for owner in [*modules, *classes]:
        place = getattr(owner, "__module__", ""), getattr(owner, "__qualname__", owner.__name__)
        functions |= {(*place, name): value for name, value in [*vars(owner).items()] if inspect.isroutine(value)}
    return functions

before = functions_of_packages()
import workbench as wb
wb.run("walk_straight", "dataset.n_frames=2", "inference.n_particles=5", "dataset.width=64", "dataset.height=48",
       "dataset.person_px=30", "dataset.focal_px=70", quiet=True)
after = functions_of_packages()
changed = [name for name, value in before.items() if after[name] is not value]
assert not changed, changed
"""
    python(code, tmp_path)


RUN = """
def small(wb, folder):
    run = wb.run("walk_straight", "dataset.n_frames=3", "inference.n_particles=50", "dataset.width=96",
                 "dataset.height=72", "dataset.person_px=50", "dataset.focal_px=105", folder=folder, quiet=True)
    return run.poses[1].tobytes().hex()
"""


@pytest.mark.slow
def test_a_run_is_the_same_in_a_script_after_numpy_and_inside_a_hydra_application(tmp_path):
    """The application's own callback, resolver and configuration still work."""
    exec(RUN, scope := {})
    plain = scope["small"](wb, tmp_path / "plain")
    after_numpy = python(f"import numpy, scipy\n{RUN}\nimport workbench as wb\nprint(small(wb, 'numpy'))", tmp_path)
    (tmp_path / "mine.yaml").write_text(
        "hydra:\n  callbacks:\n    mine: {_target_: callbacks.Mine}\nvalue: ${mine:3}\n"
    )
    (tmp_path / "callbacks.py").write_text(
        """
from hydra.experimental.callback import Callback

class Mine(Callback):
    def on_job_end(self, config, job_return, **kwargs):
        print("callback", config.value)
"""
    )
    (tmp_path / "application.py").write_text(
        f"""
import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf
{RUN}
OmegaConf.register_new_resolver("mine", lambda value: value + 1)

@hydra.main(version_base="1.1", config_path=".", config_name="mine")
def main(config):
    import workbench as wb
    name, before = HydraConfig.get().job.name, GlobalHydra.instance().hydra
    print(small(wb, "{tmp_path}/hydra"))
    assert HydraConfig.get().job.name == name
    assert GlobalHydra.instance().hydra is before

if __name__ == "__main__":
    main()
"""
    )
    command = [sys.executable, "application.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    *_, bits, callback = done.stdout.splitlines()  # after the log of the application
    assert bits == plain == after_numpy.strip()
    assert callback == "callback 4"


def test_the_command_leaves_the_environment_of_its_caller_unchanged(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = dict(os.environ)
    assert run(["experiment=nothing"]) == 2
    assert dict(os.environ) == before
