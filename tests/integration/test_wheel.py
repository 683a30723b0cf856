"""A wheel contains all files of a run: installed without the sources, it tracks a person."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ("workbench", "conf", "pyproject.toml", "README.md", "LICENSE")


def run(*command, cwd, env=None):
    completed = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=300, check=False)
    assert completed.returncode == 0, f"{command}: {completed.stdout[-2000:]}{completed.stderr[-2000:]}"
    return completed.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel from a copy of the sources, because setuptools writes next to them."""
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in SOURCES:
        path = ROOT / name
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(path, source / name, symlinks=True, ignore=ignored) if path.is_dir() else shutil.copy(
            path, source
        )
    run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(source), cwd=folder)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Install the wheel into a virtual environment that finds the dependencies in this environment."""
    folder = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", "--without-pip", str(folder / "venv"), cwd=folder)
    python = folder / "venv" / "bin" / "python"
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    (site / "dependencies.pth").write_text(
        "\n".join(path for path in sys.path if path.endswith("site-packages")) + "\n"
    )
    install = ["-m", "pip", f"--python={python}", "install", "-q", "--no-deps", "--no-index", str(wheel)]
    run(sys.executable, *install, cwd=folder)
    return folder


@pytest.mark.slow
def test_the_wheel_contains_configurations_templates_and_py_typed(wheel):
    names = ZipFile(wheel).namelist()
    options = {path.relative_to(ROOT / "conf").as_posix() for path in (ROOT / "conf").rglob("*.yaml")}
    assert {f"workbench/conf/{option}" for option in options} <= set(names)
    assert {
        "workbench/py.typed",
        "workbench/results/page.html",
        "workbench/results/measure/measures.html",
        "workbench/results/report/report.html",
        "workbench/detections/annotation/page.html",
    } <= set(names)


@pytest.mark.slow
def test_the_default_experiment_runs_from_the_wheel(installed):
    """It loads the compiled kernels of this checkout, whose sources are the same."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("WORKBENCH_", "PYTHON"))}
    environment |= {"WORKBENCH_CACHE": str(installed / "cache"), "NUMBA_CACHE_DIR": str(installed / "kernels")}
    kernels = ROOT / "workbench" / "__pycache__" / "kernels"
    if kernels.is_dir():
        shutil.copytree(kernels, installed / "kernels" / "workbench", ignore=shutil.ignore_patterns("*.tmp.*"))
    command = str(installed / "venv" / "bin" / "workbench")
    python = str(installed / "venv" / "bin" / "python")
    imported = run(python, "-c", "import workbench; print(workbench.__file__)", cwd=installed, env=environment)
    assert Path(imported.strip()).is_relative_to(installed)
    small = ["dataset.n_frames=3", "inference.n_particles=50", "hydra.run.dir=out"]
    assert "verdict: " in run(command, "run", *small, cwd=installed, env=environment)
    assert (installed / "out" / "run.rrd").is_file()
