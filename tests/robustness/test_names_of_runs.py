"""Runs whose names and texts are anybody's: no command runs them, steers the terminal, or touches what is elsewhere."""

import os
from pathlib import Path

import pytest
from run_folders import write_run
from small_recordings import write_recorded_run

from workbench.cli import view
from workbench.cli.main import main

NASTY, LONG = "<script>alert(1)</script>\n../../etc\x1b[31m\x07", "k" * 10_000
NAMES = ["two\nlines", "--rm", "esc\x1b[31m", "a b'c\"d"]
NO_TEXT = "\udcff"  # a name that is not UTF-8; nothing can be recorded into such a folder


def tree(folder):
    """Return what is below a folder: contents, and targets of links, by name."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_symlink() or path.is_file()]
    return {path: os.readlink(path) if path.is_symlink() else path.read_bytes() for path in paths}


@pytest.fixture
def home(tmp_path, monkeypatch, trusted):
    """Runs with nasty names in the current folder, from which a link leads to one outside."""
    outside = write_recorded_run(tmp_path / "outside" / "run", "outside")
    for k, name in enumerate(NAMES):
        write_recorded_run(
            tmp_path / "home" / name, f"{NASTY}{k}", prior=NASTY, day=1 + k, experiment=NASTY,
            settings={LONG: 1.0, NASTY: NASTY, "seed": k, "prior": {"_target_": NASTY}, "paths": NASTY},
            metrics={"mpjpe_abs_mm": 10.0 + k, LONG: 1.0, NASTY: 2.0},
            origin={"commit": "; rm -rf ~", "command": f"workbench; rm -rf ~ {NASTY}", "inputs": [NASTY]},
        )  # fmt: skip
    write_run(tmp_path / "home" / NO_TEXT, day=29, status="failed")
    (tmp_path / "home" / "linked").symlink_to(outside)
    monkeypatch.chdir(tmp_path / "home")
    return tmp_path / "home"


@pytest.fixture
def called(home, capsys):
    """Call workbench runs; return the exit code, the output and the errors. Nothing outside changes."""
    before = tree(home.parent / "outside")

    def command(*words):
        code = main(["runs", *words])
        out, err = capsys.readouterr()
        assert tree(home.parent / "outside") == before
        assert all(line.isprintable() for line in err.splitlines())
        return code, out, err

    return command


@pytest.mark.parametrize("words", [["list", ".", "--columns", f"{LONG},{NASTY},varied"], ["rm", "."]])
def test_a_table_has_a_printable_line_for_each_run(called, home, words):
    before = tree(home)
    code, out, _ = called(*words)
    assert code == 0
    lines = out.split("\n")[:-1]
    assert len(lines) == len(NAMES) + 2
    assert all(line.isprintable() and len(line) < 2000 for line in lines)
    assert tree(home) == before


def test_a_recorded_command_is_quoted(called, home):
    for name in NAMES:
        assert "rm -rf ~" not in called("restore", f"./{name}")[1]
    origin = {"command": "workbench 'seed=$(touch pwned)'; touch pwned", "commit": "a" * 40}
    write_recorded_run(home / "sly", "sly", origin=origin)
    _, out, _ = called("restore", "sly")
    assert out.splitlines()[-1] == ".venv/bin/workbench 'seed=$(touch pwned);' touch pwned"


def test_the_viewer_gets_files_and_no_options(called, monkeypatch):
    opened = []
    monkeypatch.setattr(view, "view", lambda words: opened.extend(map(str, words)))
    assert called("list", ".", "--view", "0")[0] == 0
    assert len(opened) == len(NAMES)
    assert all(Path(word).is_file() and not word.startswith("-") for word in opened)


def test_removing_leaves_what_is_outside(called, home):
    assert called("rm", ".", "--yes")[0] == 0
    assert [each.name for each in home.iterdir()] == ["linked"]
