"""Runs of strangers: whatever their names and texts are, nothing is lost, nothing outside is touched, all is said."""

import csv
import json
import os
import shutil
import subprocess
import sys
import tarfile
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import pytest
from run_folders import leave, leave_sweep
from small_recordings import leave_recorded

from workbench.cli import gallery, view
from workbench.cli.runs import main
from workbench.recording.read.reader import read

HOSTILE = "<script>alert(1)</script>\n../../etc\x1b[31m\x07"
LONG = "k" * 10_000
NAMES = ["<script>alert(1)<", "two\nlines", "--rm", "-rf", "esc\x1b[31m", "a..", "a b'c\"d", "x.rrd", "é" * 100]
NO_TEXT = "\udcff"  # a name that is no UTF-8; nothing can be recorded into such a folder
ALL = [*NAMES, NO_TEXT]


def tree(folder):
    """What lies below a folder: names, what links lead to, contents."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_symlink() or path.is_file()]
    return {
        str(path.relative_to(folder)): os.readlink(path) if path.is_symlink() else path.read_bytes() for path in paths
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Runs of a stranger in `home`, and in `outside` what nobody named."""
    folder = tmp_path_factory.mktemp("made")
    leave_recorded(folder / "outside" / "run", "outside")
    for k, name in enumerate(NAMES):
        leave_recorded(
            folder / "home" / name, f"{HOSTILE}{k}", prior=HOSTILE, day=1 + k, experiment=HOSTILE,
            settings={LONG: 1.0, HOSTILE: HOSTILE, "seed": k, "prior": {"_target_": HOSTILE}, "paths": HOSTILE},
            metrics={"error_abs_mm": 10.0 + k, LONG: 1.0, HOSTILE: 2.0},
            origin={"commit": "; rm -rf ~", "command": f"workbench; rm -rf ~ {HOSTILE}", "inputs": [HOSTILE]},
        )  # fmt: skip
    leave(folder / "home" / NO_TEXT, day=29, status="failed")
    return folder


@pytest.fixture
def outside(made, tmp_path):
    return shutil.copytree(made / "outside", tmp_path / "outside")


@pytest.fixture
def root(made, tmp_path, outside, monkeypatch):
    """The folder of the stranger's runs, which is where we are; a link leads out of it."""
    root = shutil.copytree(made / "home", tmp_path / "home")
    (root / "linked").symlink_to(outside / "run")
    monkeypatch.chdir(root)
    return root


@pytest.fixture
def told(root, outside, capsys):
    """Run the command in the folder: (exit code, what was printed, what was printed as errors)."""
    before = tree(outside)

    def command(*words):
        try:
            code = main(words)
        except SystemExit as end:  # argparse's own
            code = end.code
        out, err = capsys.readouterr()
        assert tree(outside) == before
        assert all(line.isprintable() and line.startswith("workbench-") for line in err.splitlines()), err
        return code, out, err

    return command


def lines_of(out):
    """The lines of a table, each a run; nothing in them steers a terminal."""
    lines = out.split("\n")[:-1]
    assert all(line.isprintable() and len(line) < 2000 for line in lines)
    return lines


def test_a_table_has_a_line_for_each_run(told):
    code, out, _ = told(".")
    assert code == 0
    assert len(lines_of(out)) == 1 + len(ALL)
    code, out, _ = told(".", "--columns", f"{LONG},{HOSTILE},varied")
    assert code == 0
    assert len(lines_of(out)) == 1 + len(ALL)


def test_json_and_csv_hold_every_run(told):
    _, out, _ = told(".", "--json")
    assert {each["path"] for each in json.loads(out)} == set(ALL)
    _, out, _ = told(".", "--csv")
    assert len(list(csv.DictReader(StringIO(out)))) == len(ALL)


def test_a_difference_is_a_table(told):
    code, out, _ = told("--diff", "./--rm", "./-rf")
    assert code == 0
    assert any(line.split()[:2] == ["result", "error_abs_mm"] for line in lines_of(out))


def test_nothing_recorded_becomes_a_command(told):
    for name in NAMES:
        code, out, err = told("--restore", f"./{name}")
        assert code == 0
        assert "rm -rf ~" not in out
        assert out.startswith("workbench-check ")
        assert "the recorded command is none of the workbench's" in err
        assert "which code made it is not known" in err


def test_a_recorded_command_is_quoted_anew(told, root):
    origin = {"command": "workbench 'seed=$(touch pwned)'; touch pwned", "commit": "a" * 40}
    leave_recorded(root / "sly", "sly", origin=origin)
    _, out, _ = told("--restore", "sly")
    assert out.splitlines()[-1] == ".venv/bin/workbench 'seed=$(touch pwned);' touch pwned"


def test_a_report_holds_every_run(told):
    code, out, _ = told(".", "--report")
    assert code == 0
    assert lines_of(out)


def test_the_viewer_is_handed_files_and_no_options(told, root, monkeypatch):
    opened = []
    monkeypatch.setattr(view, "main", lambda words: opened.extend(words) or 0)
    assert told(".", "--view", "all")[0] == 0
    assert len(opened) == len(NAMES)
    assert all(Path(word).is_file() and not word.startswith("-") for word in opened)


@pytest.mark.skipif(find_spec("datafusion") is None, reason="needs the extra 'catalog'")
def test_a_gallery_shows_every_run(told, monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    monkeypatch.setattr(gallery, "wait", interrupt)
    code, out, err = told(".", "--serve")
    assert code == 0
    assert err == "workbench-runs:  : left out, as it has no recording (failed)\n"
    assert out.startswith(f"{len(NAMES)} runs as cards at rerun+http://127.0.0.1:")


def test_a_dry_run_touches_nothing_and_each_is_one_line(told, root):
    before = tree(root)
    code, out, _ = told(".", "--rm")
    assert code == 0
    assert len(lines_of(out)) == len(ALL) + 1
    assert {name: value for name, value in tree(root).items() if name != ".runs.json"} == before


def test_removing_leaves_what_is_outside(told, root):
    assert told(".", "--rm", "--yes")[0] == 0
    assert sorted(each.name for each in root.iterdir()) == [".runs.json", "linked"]


def test_slimming_keeps_the_numbers_and_what_links_lead_to(told, root, outside):
    (root / "-rf" / "run.rrd").unlink()
    (root / "-rf" / "run.rrd").symlink_to(outside / "run" / "run.rrd")
    assert told(".", "--slim", "--yes")[0] == 0
    assert read(root / "--rm" / "run.rrd").result["error_abs_mm"] == 12.0


def test_an_archive_unpacks_below_the_folder_it_is_unpacked_in(told, tmp_path):
    assert told(".", "--archive", str(tmp_path / "all.tar.gz"))[0] == 0
    with tarfile.open(tmp_path / "all.tar.gz") as tar:
        names = tar.getnames()
    assert {name.partition("/")[0] for name in names} == set(ALL)
    assert not any(name.startswith("/") or ".." in Path(name).parts for name in names)


def test_an_archive_is_written_whole_or_not_at_all(told, root, tmp_path, monkeypatch):
    monkeypatch.setattr(tarfile.TarFile, "add", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "No space left")))
    code, _, err = told(".", "--archive", str(tmp_path / "all.tar.gz"))
    assert (code, list(tmp_path.glob("all*"))) == (2, [])
    assert "cannot be written: No space left" in err


def test_an_index_of_a_stranger_leads_nowhere_else(told, root, outside):
    told(".")
    index = json.loads((root / ".runs.json").read_text())
    for _, fields, _ in index["runs"].values():
        fields["path"], fields["recording"] = str(outside / "run"), str(outside / "run" / "run.rrd")
    (root / ".runs.json").write_text(json.dumps(index))
    assert told(".", "--rm", "--yes")[0] == 0
    assert sorted(each.name for each in root.iterdir()) == [".runs.json", "linked"]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_an_index_cut_off_loses_no_run(told, root, share):
    _, first, _ = told(".", "--json")
    whole = (root / ".runs.json").read_bytes()
    (root / ".runs.json").write_bytes(whole[: int(share * len(whole))])
    assert told(".", "--json") == (0, first, "")
    assert (root / ".runs.json").read_bytes() == whole


def test_a_run_that_claims_another_s_id_is_a_run_of_its_own(told, root):
    leave_recorded(root / "thief", f"{HOSTILE}0", day=20, metrics={"error_abs_mm": 1.0})
    _, out, _ = told(".", "--json")
    assert len(json.loads(out)) == len(ALL) + 1
    assert told("thief", "--rm", "--yes")[0] == 2  # a run is removed as one of the folder that it is in
    assert told(".", "path=thief", "--rm", "--yes")[0] == 0
    assert (root / NAMES[0] / "run.rrd").is_file()


@pytest.mark.slow
def test_commands_at_once_on_one_folder_lose_nothing(tmp_path):
    leave_sweep(tmp_path / "sweep", seeds=range(50))
    leave(tmp_path / "kept", prior="implicit")
    command = [sys.executable, "-m", "workbench.cli.runs", str(tmp_path)]
    words = [["prior=smooth", "--rm", "--yes"], ["prior=smooth", "--rm", "--yes"], ["--csv"], ["--json"]]
    running = [subprocess.Popen([*command, *each], stdout=subprocess.PIPE, stderr=subprocess.PIPE) for each in words]
    for process in running:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0 or err.startswith(b"workbench-runs: ")
        assert b"Traceback" not in err
    left = json.loads(subprocess.run([*command, "--json"], check=True, capture_output=True).stdout)
    assert sorted({each["choices"]["prior"] for each in left}) == ["implicit", "walking"]
    assert len(left) == 101
    assert not list(tmp_path.rglob("*.part"))
