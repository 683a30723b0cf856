"""Components of a user's package, named with `component_packages`: runs, checks, sweeps and contracts."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.cli.main import main
from workbench.experiment.config import options

SMALL = (
    "experiment=custom", "dataset=nodding", "dataset.n_frames=3", "prior=still", "likelihood=upright",
    "inference.n_particles=20", "recorder.n_particles_shown=5",
)  # fmt: skip


TARGETS = ("my_components.still.Still", "my_components.upright.Upright")
SCENES = Path(__file__).parents[1] / "scenes"
"""Folder of the package `my_components`: a prior, a likelihood and a dataset."""
PAGE = SCENES.parents[1] / "docs" / "howto" / "own_components.md"


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """Return a folder and a function that runs a command there in a subprocess, with the package on PYTHONPATH."""
    folder = tmp_path_factory.mktemp("own")
    environment = {**os.environ, "PYTHONPATH": str(SCENES), "WORKBENCH_CACHE": str(folder / "cache")}
    for name in ("WORKBENCH_DATA", "WORKBENCH_COMPONENTS", "PYTEST_ADDOPTS"):
        environment.pop(name, None)

    def call(module, *arguments, cwd=folder, **variables):
        return subprocess.run(
            [sys.executable, "-P", "-m", module, *arguments],
            cwd=cwd, env=environment | variables, capture_output=True, text=True, timeout=600, check=False,
        )  # fmt: skip

    return folder, call


@pytest.fixture
def no_package(monkeypatch):
    """Allow no package in this process, now and in the next tests."""
    monkeypatch.setattr(options, "_allowed", [])


@pytest.mark.slow
def test_own_components_run_and_are_checked(command, capsys, no_package):
    folder, call = command
    completed = call("workbench", "run", "component_packages=[my_components]", *SMALL, "hydra.run.dir=out")
    assert completed.returncode == 0, completed.stderr
    assert main(["check", str(folder / "out" / "run.rrd")]) == 2
    output = capsys.readouterr().out
    assert "my_components.nodding.Nodding' is no component of the workbench" in output
    assert "component_packages=[my_components]" in output
    assert main(["check", str(folder / "out" / "run.rrd"), "component_packages=[my_components]"]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_a_sweep_is_reported_and_its_workers_import_nothing_from_the_current_folder(
    command, tmp_path, launcher, capsys
):
    """Modules of the current folder with names that Python and the workbench import; own components are imported."""
    pytest.importorskip(f"hydra_plugins.hydra_{launcher.partition('_')[0]}_launcher")
    for name in ("tempfile", "subprocess", "numpy", "workbench"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'a').write('{name} ')\n")
    workers = ["hydra.launcher.n_jobs=2"] if launcher == "joblib" else ["hydra.launcher.timeout_min=5"]
    words = ["component_packages=[my_components]", *SMALL, "seed=0", f"hydra/launcher={launcher}", *workers]
    _, call = command
    completed = call("workbench", "run", "-m", *words, cwd=tmp_path)
    assert not (tmp_path / "imported").exists()
    assert completed.returncode == 0, completed.stdout + completed.stderr
    (sweep,) = tmp_path.glob("recordings/sweeps/*/*")
    assert main(["report", str(sweep)]) == 0
    assert "1 complete" in capsys.readouterr().out


@pytest.mark.slow
def test_the_code_of_the_page_runs(command, tmp_path):
    """A package with only the code and the YAML of the page runs with its first command, at small size."""
    page = PAGE.read_text(encoding="utf-8")
    (text,) = re.findall(r"```yaml\n(.+?)```", page, re.DOTALL)
    for name, code in re.findall(r"^`my_components/(\w+)\.py`:\n\n```python\n(.+?)```", page, re.MULTILINE | re.DOTALL):
        group = {"still": "prior", "upright": "likelihood"}[name]
        option = tmp_path / "my_components" / "conf" / group / f"{name}.yaml"
        option.parent.mkdir(parents=True)
        option.write_text(text.replace("upright.Upright", f"{name}.{name.title()}"))
        (tmp_path / "my_components" / f"{name}.py").write_text(code)
    _, call = command
    command_line = next(line for line in page.splitlines() if line.startswith("workbench run component_packages="))
    small = ["dataset.n_frames=3", "inference.n_particles=20", f"hydra.run.dir={tmp_path / 'out'}"]
    completed = call("workbench", "run", *shlex.split(command_line)[2:], *small, PYTHONPATH=str(tmp_path))
    assert completed.returncode == 0, completed.stderr
    settings = json.loads((tmp_path / "out" / "summary.json").read_text())["settings"]
    assert (settings["prior"]["_target_"], settings["likelihood"]["_target_"]) == TARGETS


@pytest.fixture
def run_pytest(command, no_package, tmp_path, monkeypatch, capfd):
    """Return a function that runs pytest in this process, which saves the imports: exit code and output."""
    monkeypatch.setenv("WORKBENCH_CACHE", str(command[0] / "cache"))
    for name in ("WORKBENCH_DATA", "PYTEST_ADDOPTS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)

    def run_pytest(*arguments):
        code = pytest.main(["-p", "no:xdist", "-p", "no:cacheprovider", "--import-mode=importlib", *arguments])
        return code, capfd.readouterr().out

    return run_pytest


@pytest.mark.slow
def test_a_users_test_keeps_a_baseline(run_pytest, trusted):
    """The page's test fails without a baseline, writes one, and passes; with another key of the component it fails."""
    (test,) = re.findall(r"```python\n(import workbench as wb\n.+?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    Path("test_still.py").write_text(test)
    code, output = run_pytest()
    assert (code, "1 failed" in output, "is no baseline yet; write it by" in output) == (1, True, True)
    assert run_pytest("--workbench-update")[0] == 0
    shutil.copytree("baselines/test_still", "baselines/test_changed")
    Path("test_changed.py").write_text(test.replace('"prior=still"', '"prior=still", "prior.sigma=0.05"'))
    code, output = run_pytest()
    assert (code, "1 failed, 1 passed" in output) == (1, True)
    assert "prior.sigma: 0.02 → 0.05" in output


@pytest.mark.slow
def test_own_components_pass_the_contract_tests(run_pytest):
    code, output = run_pytest("--pyargs", "workbench.contracts", "--component-package", "my_components")
    assert (code, "12 passed" in output) == (0, True), output


@pytest.mark.parametrize("name", ["still", "upright"])
def test_the_page_shows_the_code_of_the_package(name):
    assert (SCENES / "my_components" / f"{name}.py").read_text(encoding="utf-8") in PAGE.read_text(encoding="utf-8")
