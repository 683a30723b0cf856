"""A package of one's own, named on the command line: a run, its check, a sweep; and the check without the name."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

SMALL = (
    "experiment=custom", "dataset=nodding", "dataset.n_frames=3", "prior=still", "likelihood=upright",
    "inference.n_particles=20", "recorder.n_particles_shown=5",
)  # fmt: skip


TARGETS = ("my_components.still.Still", "my_components.upright.Upright")
SCENES = Path(__file__).parents[1] / "scenes"
"""Where the package `my_components` lies: a prior, a likelihood and a dataset, forty lines each at most."""
PAGE = SCENES.parents[1] / ".docs" / "howto" / "own_components.md"


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """Run a command of the workbench with the package on PYTHONPATH, as a process of its own."""
    folder = tmp_path_factory.mktemp("own")
    environment = {**os.environ, "PYTHONPATH": str(SCENES), "WORKBENCH_CACHE": str(folder / "cache")}
    for name in ("WORKBENCH_DATA", "WORKBENCH_COMPONENTS", "PYTEST_ADDOPTS"):
        environment.pop(name, None)

    def call(module, *arguments, **other):
        return subprocess.run(
            [sys.executable, "-m", module, *arguments],
            cwd=folder, env=environment | other, capture_output=True, text=True, timeout=600, check=False,
        )  # fmt: skip

    return folder, call


@pytest.mark.slow
def test_a_run_its_check_and_a_sweep(command):
    folder, call = command
    done = call("workbench", "run", "component_packages=[my_components]", *SMALL, "hydra.run.dir=out")
    assert done.returncode == 0, done.stderr
    done = call("workbench", "check", "out/run.rrd", "component_packages=[my_components]")
    assert done.returncode == 0, done.stdout + done.stderr
    done = call("workbench", "check", "out/run.rrd")
    assert done.returncode == 2
    assert (
        "my_components.nodding.Nodding' is no component of the workbench; if you trust its package, add "
        "component_packages=[my_components]" in done.stdout
    )
    done = call(
        "workbench", "run", "-m", "component_packages=[my_components]", *SMALL, "seed=0,1", "hydra.sweep.dir=sweep"
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for job in "01":
        assert json.loads((folder / "sweep" / job / "summary.json").read_text())["status"] == "complete"
    done = call("workbench", "report", "sweep")  # which builds nothing
    assert done.returncode == 0, done.stderr
    assert "2 complete" in done.stdout


@pytest.mark.slow
def test_the_workers_of_a_launcher_build_the_components_of_a_named_package(command):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    folder, call = command
    words = ["seed=0,1", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "hydra.sweep.dir=workers"]
    done = call("workbench", "run", "-m", "component_packages=[my_components]", *SMALL, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads((folder / "workers" / "1" / "summary.json").read_text())["status"] == "complete"


@pytest.mark.slow
def test_the_page_is_enough_to_use_a_likelihood_and_a_prior_by_name(command, tmp_path):
    """With nothing but what the page shows: its code, its YAML and its first command, made small."""
    page = PAGE.read_text(encoding="utf-8")
    (text,) = re.findall(r"```yaml\n(.+?)```", page, re.DOTALL)
    for name, code in re.findall(r"^`my_components/(\w+)\.py`:\n\n```python\n(.+?)```", page, re.MULTILINE | re.DOTALL):
        group = {"still": "prior", "upright": "likelihood"}[name]
        option = tmp_path / "my_components" / "conf" / group / f"{name}.yaml"
        option.parent.mkdir(parents=True)
        option.write_text(text.replace("upright.Upright", f"{name}.{name.title()}"))
        (tmp_path / "my_components" / f"{name}.py").write_text(code)
    _, call = command
    said = next(line for line in page.splitlines() if line.startswith("workbench run component_packages="))
    small = ["dataset.n_frames=3", "inference.n_particles=20", f"hydra.run.dir={tmp_path / 'out'}"]
    done = call("workbench", "run", *shlex.split(said)[2:], *small, PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    chosen = json.loads((tmp_path / "out" / "summary.json").read_text())["settings"]
    assert (chosen["prior"]["_target_"], chosen["likelihood"]["_target_"]) == TARGETS


@pytest.mark.slow
def test_its_parts_keep_the_contracts(command):
    _, call = command
    done = call(
        "pytest", "--pyargs", "workbench.contracts", "--component-package", "my_components", "-q", "-p", "no:xdist"
    )
    assert done.returncode == 0, done.stdout
    assert "12 passed" in done.stdout


@pytest.mark.parametrize("name", ["still", "upright"])
def test_the_page_shows_the_code_of_the_tested_package(name):
    assert (SCENES / "my_components" / f"{name}.py").read_text(encoding="utf-8") in PAGE.read_text(encoding="utf-8")


@pytest.mark.slow
def test_without_its_name_the_option_is_not_there(command):
    _, call = command
    done = call("workbench", "run", *SMALL)
    assert done.returncode == 2
    assert re.search("there is no option '(nodding|still|upright)'", done.stderr)
    assert "Traceback" not in done.stderr
