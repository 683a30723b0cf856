"""The layout holds: arrows between rooms point down, and only some rooms know Rerun and Hydra."""

from pathlib import Path

from importlinter.cli import lint_imports


def test_imports_keep_the_layout(capsys):
    code = lint_imports(config_filename=str(Path(__file__).parents[2] / "pyproject.toml"), cache_dir=None)
    assert code == 0, capsys.readouterr().out
