"""Imports between packages follow the layers, and every package is installed."""

import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_imports_follow_the_layers():
    """In a subprocess, because import-linter disables all loggers."""
    lint = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(cache_dir=None))"
    done = subprocess.run([sys.executable, "-c", lint], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_every_package_is_installed():
    installed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    packages = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "workbench").rglob("__init__.py")}
    assert set(installed) == packages | {"workbench.conf"}


def test_the_import_graph_in_the_documents_is_current():
    drawing = runpy.run_path(str(ROOT / "docs" / "import_graph.py"))
    assert drawing["PICTURE"].read_text(encoding="utf-8") == drawing["picture"](), "run python docs/import_graph.py"
    graph = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
    assert drawing["reduced"](graph) == {"a": {"b"}, "b": {"c"}, "c": set()}
