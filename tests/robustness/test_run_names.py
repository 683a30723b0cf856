"""Runs with hostile names and texts: no command executes them, controls the terminal or changes other folders."""

import os
from pathlib import Path

import pytest
from run_folders import write_run
from small_recordings import write_recorded_run

from workbench.cli import view
from workbench.cli.main import main

HOSTILE, LONG = "<script>alert(1)</script>\n../../etc\x1b[31m\x07", "k" * 10_000
NAMES = ["two\nlines", "--rm", "esc\x1b[31m", "a b'c\"d"]
NOT_UTF8 = "\udcff"  # nothing can be recorded into a folder of this name


def tree(folder):
    """Return the contents of files and the targets of links below a folder, by path."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_symlink() or path.is_file()]
    return {path: os.readlink(path) if path.is_symlink() else path.read_bytes() for path in paths}


@pytest.fixture
def home(tmp_path, monkeypatch, trusted):
    """Return the current folder, with runs of hostile names and a link to a run outside."""
    outside = write_recorded_run(tmp_path / "outside" / "run", "outside")
    for k, name in enumerate(NAMES):
        write_recorded_run(
            tmp_path / "home" / name, f"{HOSTILE}{k}", prior=HOSTILE, day=1 + k, experiment=HOSTILE,
            settings={LONG: 1.0, HOSTILE: HOSTILE, "seed": k, "prior": {"_target_": HOSTILE}, "paths": HOSTILE},
            metrics={"mpjpe_abs_mm": 10.0 + k, LONG: 1.0, HOSTILE: 2.0},
            origin={"commit": "; rm -rf ~", "command": f"workbench; rm -rf ~ {HOSTILE}", "inputs": [HOSTILE]},
        )  # fmt: skip
    write_run(tmp_path / "home" / NOT_UTF8, day=29, status="failed")
    (tmp_path / "home" / "linked").symlink_to(outside)
    monkeypatch.chdir(tmp_path / "home")
    return tmp_path / "home"


@pytest.fixture
def called(home, capsys):
    """Return a function that calls `workbench runs` and checks that nothing outside the folder changes."""
    before = tree(home.parent / "outside")

    def command(*words):
        code = main(["runs", *words])
        out, err = capsys.readouterr()
        assert tree(home.parent / "outside") == before
        assert all(line.isprintable() for line in err.splitlines())
        return code, out, err

    return command


@pytest.mark.parametrize("words", [["list", ".", "--columns", f"{LONG},{HOSTILE},varied"], ["rm", "."]])
def test_a_table_has_one_printable_line_per_run(called, home, words):
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
    write_recorded_run(home / "injected", "injected", origin=origin)
    _, out, _ = called("restore", "injected")
    assert out.splitlines()[-1] == ".venv/bin/workbench 'seed=$(touch pwned);' touch pwned"


def test_the_viewer_receives_files_and_no_options(called, monkeypatch):
    opened = []
    monkeypatch.setattr(view, "view", lambda words: opened.extend(map(str, words)))
    for name in NAMES:
        assert called("list", f"./{name}", "--view", "1")[0] == 0
    assert len(opened) == len(NAMES)
    assert all(Path(word).is_file() and not word.startswith("-") for word in opened)


def test_a_removal_does_not_follow_links(called, home):
    assert called("rm", ".", "--yes")[0] == 0
    assert [path.name for path in home.iterdir()] == ["linked"]
