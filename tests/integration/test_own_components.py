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

pytest_plugins = ["pytester"]

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


@pytest.mark.slow
def test_own_components_run_and_are_checked(command, capsys):
    folder, call = command
    completed = call("workbench", "run", "component_packages=[my_components]", *SMALL, "hydra.run.dir=out")
    assert completed.returncode == 0, completed.stderr
    completed = call("workbench", "check", "out/run.rrd", "component_packages=[my_components]")
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert main(["check", str(folder / "out" / "run.rrd")]) == 2  # in this process, which allows no package
    output = capsys.readouterr().out
    assert "my_components.nodding.Nodding' is no component of the workbench" in output
    assert "component_packages=[my_components]" in output


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
    words = ["component_packages=[my_components]", *SMALL, "seed=0,1", f"hydra/launcher={launcher}", *workers]
    _, call = command
    completed = call("workbench", "run", "-m", *words, cwd=tmp_path)
    assert not (tmp_path / "imported").exists()
    assert completed.returncode == 0, completed.stdout + completed.stderr
    (sweep,) = tmp_path.glob("recordings/sweeps/*/*")
    assert main(["report", str(sweep)]) == 0
    assert "2 complete" in capsys.readouterr().out


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


@pytest.mark.slow
def test_a_users_test_keeps_a_baseline(command, pytester, monkeypatch):
    """The page's test fails without a baseline, writes one, and passes; with another key of the component it fails."""
    (code,) = re.findall(r"```python\n(import workbench as wb\n.+?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    pytester.makepyfile(test_still=code)
    monkeypatch.setenv("PYTHONPATH", str(SCENES))
    monkeypatch.setenv("WORKBENCH_CACHE", str(command[0] / "cache"))
    for options, failed in (([], 1), (["--workbench-update"], 0)):
        done = pytester.runpytest_subprocess("-p", "no:xdist", *options)
        done.assert_outcomes(failed=failed, passed=1 - failed)
        assert (failed == 1) == ("is no baseline yet; write it by" in done.stdout.str())
    baselines = pytester.path / "baselines"
    shutil.copytree(baselines / "test_still", baselines / "test_changed")
    pytester.makepyfile(test_changed=code.replace('"prior=still"', '"prior=still", "prior.sigma=0.05"'))
    done = pytester.runpytest_subprocess("-p", "no:xdist")
    done.assert_outcomes(passed=1, failed=1)
    assert "prior.sigma: 0.02 → 0.05" in done.stdout.str()


@pytest.mark.slow
def test_own_components_pass_the_contract_tests(command):
    _, call = command
    completed = call(
        "pytest", "--pyargs", "workbench.contracts", "--component-package", "my_components", "-q", "-p", "no:xdist"
    )
    assert completed.returncode == 0, completed.stdout
    assert "12 passed" in completed.stdout


@pytest.mark.parametrize("name", ["still", "upright"])
def test_the_page_shows_the_code_of_the_package(name):
    assert (SCENES / "my_components" / f"{name}.py").read_text(encoding="utf-8") in PAGE.read_text(encoding="utf-8")
