"""workbench-runs in the terminal: tables, queries, differences, and what must be said twice."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from io import StringIO

import pytest
from run_folders import leave, leave_sweep
from small_recordings import leave_recorded

from workbench.cli import gallery, runs, view
from workbench.cli.runs import main
from workbench.recording.read import crash_probe as probe
from workbench.utils.run_files import EARLIER
from workbench.utils.run_lock import locked


@pytest.fixture
def root(tmp_path):
    leave_sweep(tmp_path / "sweep")
    leave(tmp_path / "lost", prior="implicit", status="failed", error=400.0, day=28)
    return tmp_path


@pytest.fixture
def told(root, capsys):
    """Run the command on the folder: (exit code, lines printed, what was printed as errors)."""

    def command(*words):
        code = main([str(root), *words])
        out, err = capsys.readouterr()
        return code, out.splitlines(), err

    return command


def test_the_newest_come_first_with_what_varied(told, root):
    code, lines, _ = told()
    assert code == 0
    assert lines[0].split() == [
        "path",
        "started",
        "status",
        "experiment",
        "varied",
        "seed",
        "error_abs_mm",
        "coverage_90",
    ]
    assert lines[1].split() == [str(root / "lost"), "2026-11-28T15:00:00", "failed", "walk_straight", "implicit,",
                                "n_particles=500", "0", "400", "0.9"]  # fmt: skip
    assert len(lines) == 14


def test_a_query_is_sorted_and_shows_the_columns_asked_for(told):
    code, lines, _ = told("prior=smooth", "error_abs_mm<14", "--sort=-error_abs_mm", "--columns", "n_particles,seed")
    assert code == 0
    assert [line.split() for line in lines] == [
        ["n_particles", "seed"],
        ["400", "0"],
        ["100", "2"],
        ["100", "1"],
        ["100", "0"],
    ]


def test_json_and_csv_hold_the_numbers(told):
    _, lines, _ = told("status=failed", "--json")
    assert json.loads("\n".join(lines))[0]["metrics"] == {"error_abs_mm": 400.0, "coverage_90": 0.9}
    _, lines, _ = told("status=failed", "--csv")
    assert next(iter(csv.DictReader(StringIO("\n".join(lines)))))["error_abs_mm"] == "400.0"


def test_sweeps_are_rows_of_their_own(told, root):
    _, lines, _ = told("--sweeps")
    assert lines[1].split()[0] == str(root / "sweep")
    assert lines[1].split()[-4:] == ["12", "12", "error_abs_mm", "10"]


def test_the_difference_is_of_configuration_and_result(root, capsys):
    assert main(["--diff", str(root / "sweep" / "0"), str(root / "sweep" / "6")]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[3:]]
    assert ["choice", "prior", "smooth", "walking"] in rows
    assert ["result", "error_abs_mm", "10.00", "16.00", "6.000"] in rows
    assert not any("n_particles" in row[1] for row in rows)


def test_nothing_is_removed_unless_it_is_said_twice(told, root):
    code, lines, _ = told("prior=smooth", "--rm")
    assert code == 0
    assert "6 runs, 0.0 MB: would be removed; nothing was done, --yes does it" in lines
    assert (root / "sweep" / "0").is_dir()
    assert told("prior=smooth", "--rm", "--yes")[0] == 0
    assert not (root / "sweep" / "0").exists()
    assert len(list(root.rglob("summary.json"))) == 7


def test_what_is_removed_with_a_run_and_what_is_not_is_told(told, root):
    before = root / "lost" / EARLIER
    before.mkdir()
    (before / "1.rrd.part").write_text("frames")
    said = f"{root / 'lost'}: with what an earlier attempt recorded, from which sweep.resume would go on"
    assert told("status=failed", "--rm")[1][0].endswith(said)
    (before / "1.rrd.part").unlink()
    (before / "1").mkdir()
    for name, text in {"run.rrd": "whole", "summary.json": (root / "sweep" / "0" / "summary.json").read_text()}.items():
        (before / "1" / name).write_text(text)
    said = f"{root / 'lost'}: the run that was there before, {before / '1'}, takes its place"
    assert told("status=failed", "--rm")[1][0].endswith(said)
    code, lines, err = told("status=failed", "--rm", "--yes")
    assert (code, lines[0], err) == (0, "1 runs removed, 0.0 MB won", f"workbench-runs: {said}\n")
    assert (root / "lost" / "run.rrd").read_text() == "whole"
    assert told("status=failed")[1] == ["no run fits"]


def test_what_steers_a_terminal_is_not_printed(told, root):
    leave(root / "hostile", prior="\x1b[31m<script>", day=29)
    _, lines, _ = told("status=complete")
    assert not any("\x1b" in line for line in lines)


@pytest.mark.parametrize("words", [["nothing_like_it=3"], ["--sort", "nothing"], ["--columns", "nothing"], ["path~("]])
def test_what_cannot_be_met_is_a_sentence(told, words):
    code, _, err = told(*words)
    assert code == 2
    assert err.startswith("workbench-runs: ")
    assert len(err.splitlines()) == 1


@pytest.mark.skipif(find_spec("datafusion") is None, reason="needs the extra 'catalog'")
def test_a_gallery_that_is_only_served_says_what_opens_it_here_and_elsewhere(tmp_path, capsys, monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    leave_recorded(tmp_path / "a", "a")
    leave(tmp_path / "b", status="failed", day=2)
    monkeypatch.setattr(gallery, "wait", interrupt)
    assert main([str(tmp_path), "--serve"]) == 0
    out, err = capsys.readouterr()
    url = re.search(r"^1 runs as cards at (rerun\+http://127\.0\.0\.1:(\d+)/entry/\w+)$", out, re.MULTILINE)
    assert f"on this machine: rerun --bind 127.0.0.1 '{url[1]}'" in out
    assert f"ssh -N -L {url[2]}:127.0.0.1:{url[2]} " in out
    assert err.startswith(f"workbench-runs: {tmp_path / 'b'}: left out")


def test_the_best_two_are_handed_to_the_viewer_by_one_command(tmp_path, monkeypatch):
    for k, error in enumerate([30.0, 10.0, 20.0]):
        leave_recorded(tmp_path / str(k), f"run {k}", error=error, day=1 + k)
    opened = []
    monkeypatch.setattr(view, "main", lambda words: opened.append(words) or 0)
    for order in ([], ["--sort", "error_abs_mm"]):
        assert main([str(tmp_path), "prior=smooth", *order, "--view", "2"]) == 0
        assert opened.pop() == [str(tmp_path / k / "run.rrd") for k in "12"]
    assert main([str(tmp_path), "--sort=-error_abs_mm", "--view"]) == 0
    assert opened.pop() == [str(tmp_path / "0" / "run.rrd")]


def test_a_query_that_the_index_answers_loads_nothing_large(root):
    words = [str(root), "prior=smooth"]
    main(words)
    large = "{'rerun', 'hydra', 'numpy'} & {*sys.modules}"
    code = f"import sys; from workbench.cli.runs import main; main({words}); print({large})"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.endswith("\nset()\n")


def test_what_cannot_be_done_for_one_run_is_said_and_done_for_the_others(told, root):
    with locked(root / "sweep" / "3"):
        code, lines, err = told("prior=smooth,walking", "--rm", "--yes")
    assert (code, lines) == (2, ["11 runs removed, 0.0 MB won"])
    assert f"workbench-runs: {root}/sweep/3: process {os.getpid()} on " in err
    assert sorted(each.name for each in (root / "sweep").iterdir()) == ["3"]


def test_a_recording_whose_run_has_ended_meanwhile_is_opened_and_one_removed_is_left_out(tmp_path, monkeypatch, capsys):
    for name in "abc":
        leave_recorded(tmp_path / name, name)
    os.replace(tmp_path / "b" / "run.rrd", tmp_path / "b" / "run.rrd.part")
    opened, best_first = [], runs.best_first

    def meanwhile(found):
        os.replace(tmp_path / "b" / "run.rrd.part", tmp_path / "b" / "run.rrd")
        shutil.rmtree(tmp_path / "c")
        return best_first(found)

    monkeypatch.setattr(runs, "best_first", meanwhile)
    monkeypatch.setattr(view, "main", lambda words: opened.extend(words) or 0)
    assert main([str(tmp_path), "--view", "all"]) == 0
    assert sorted(opened) == [str(tmp_path / "a" / "run.rrd"), str(tmp_path / "b" / "run.rrd")]
    assert capsys.readouterr().err == f"workbench-runs: {tmp_path}/c/run.rrd: left out, as it was removed meanwhile\n"


def test_a_report_of_what_is_removed_meanwhile_says_so(tmp_path, monkeypatch, capsys):
    for name in "ab":
        leave_recorded(tmp_path / name, name)
    fatal = probe.fatal
    monkeypatch.setattr(probe, "fatal", lambda paths, *_: shutil.rmtree(tmp_path / "b") or fatal(paths))
    assert main([str(tmp_path), "--report"]) == 0
    assert "b/run.rrd: no such recording" in capsys.readouterr().out


def test_a_long_condition_is_one(told):
    code, lines, _ = told(f"seed={','.join(map(str, range(1, 500)))}")
    assert code == 0
    assert len(lines) == 1 + 8
    code, _, err = told("a" * 5000)
    assert code == 2
    assert err.endswith(": File name too long\n")


def test_whole_numbers_have_all_their_digits(tmp_path, capsys):
    for k in range(2):
        leave(tmp_path / str(k), seed=20261122 + k, n=50000, error=12345.678)
    main([str(tmp_path), "--columns", "seed,n_particles,error_abs_mm", "--sort", "seed"])
    assert [line.split() for line in capsys.readouterr().out.splitlines()[1:]] == [
        ["20261122", "50000", "1.235e+04"], ["20261123", "50000", "1.235e+04"],
    ]  # fmt: skip
    main([str(tmp_path), "--columns", "seed,n_particles,error_abs_mm", "--sort", "seed", "--csv"])
    assert capsys.readouterr().out.split()[1:] == ["20261122,50000.0,12345.678", "20261123,50000.0,12345.678"]
