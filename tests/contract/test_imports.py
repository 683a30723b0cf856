"""The layout holds: arrows between rooms point down, only some rooms know Rerun and Hydra, and all are installed."""

import runpy
import tomllib
from pathlib import Path

from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[2]


def test_imports_keep_the_layout(capsys):
    code = lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None)
    assert code == 0, capsys.readouterr().out


def test_every_room_is_installed():
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    rooms = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "workbench").rglob("__init__.py")}
    assert set(told) == rooms | {"workbench.conf"}


def test_the_picture_of_the_packages_shows_their_imports():
    drawing = runpy.run_path(str(ROOT / ".docs" / "import_graph.py"))
    assert drawing["PICTURE"].read_text(encoding="utf-8") == drawing["picture"](), "run python .docs/import_graph.py"
    graph = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
    assert drawing["reduced"](graph) == {"a": {"b"}, "b": {"c"}, "c": set()}
