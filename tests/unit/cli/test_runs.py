"""`workbench runs` lists, queries, compares and removes runs."""

import csv
import json
import os
import subprocess
import sys
from io import StringIO

import pytest
from run_folders import write_run, write_sweep
from small_recordings import write_recorded_run

from workbench.cli import view
from workbench.cli.main import main
from workbench.utils.run_lock import locked


@pytest.fixture
def root(tmp_path):
    write_sweep(tmp_path / "sweep")
    write_run(tmp_path / "lost", prior="implicit", status="failed", error=400.0, day=28)
    return tmp_path


@pytest.fixture
def call(root, capsys):
    """A function that runs a subcommand on the folder and returns its exit code, lines of stdout, and stderr."""

    def command(name, *words):
        code = main(["runs", name, str(root), *words])
        out, err = capsys.readouterr()
        return code, out.splitlines(), err

    return command


def test_a_list_has_the_queried_runs_sorted_with_the_chosen_columns(call):
    words = ("prior=smooth", "mpjpe_abs_mm<14", "--sort", "-mpjpe_abs_mm", "--columns", "n_particles,seed")
    code, lines, _ = call("list", *words)
    assert code == 0
    assert [line.split() for line in lines] == [
        ["n_particles", "seed"], ["400", "0"], ["100", "2"], ["100", "1"], ["100", "0"],
    ]  # fmt: skip


def test_sorting_precedes_the_limit_of_forty_lines(tmp_path, capsys):
    """The newest runs, which an unsorted list shows first, have the largest errors."""
    for k in range(45):
        write_run(tmp_path / str(k), error=float(k), started=f"202611{k // 24 + 1:02d}T{k % 24:02d}0000.000000Z")
    assert main(["runs", "list", str(tmp_path), "--columns", "mpjpe_abs_mm"]) == 0
    assert capsys.readouterr().out.splitlines()[1].strip() == "44.00"
    assert main(["runs", "list", str(tmp_path), "--sort", "mpjpe_abs_mm", "--columns", "mpjpe_abs_mm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [float(line) for line in lines[1:41]] == list(range(40))
    assert lines[41] == "and 5 more: use --all or a narrower query"


def test_json_and_csv_contain_unrounded_numbers(call, root):
    _, lines, _ = call("list", "status=failed", "--json")
    assert json.loads("\n".join(lines))[0]["metrics"] == {"mpjpe_abs_mm": 400.0, "coverage_90": 0.9}
    _, lines, _ = call("list", "status=failed", "--csv")
    assert next(iter(csv.DictReader(StringIO("\n".join(lines)))))["mpjpe_abs_mm"] == "400.0"
    write_run(root / "other", seed=20261122, n=50000, error=12345.678, day=29)
    words = ("list", "started>2026-11-29", "--columns", "seed,n_particles,mpjpe_abs_mm")
    assert call(*words, "--csv")[1][1] == "20261122,50000,12345.678"
    assert call(*words)[1][1].split() == ["20261122", "50000", "12346"]


def test_a_diff_compares_configurations_and_results(root, capsys):
    assert main(["runs", "diff", str(root / "sweep" / "0"), str(root / "sweep" / "6")]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[3:]]
    assert ["choice", "prior", "smooth", "walking"] in rows
    assert ["result", "mpjpe_abs_mm", "10.00", "16.00", "6.000"] in rows
    assert not any("n_particles" in row[1] for row in rows)
    assert main(["runs", "diff", str(root), str(root / "lost")]) == 2
    assert capsys.readouterr().err == f"workbench: {root}: expected one run, found 13\n"


def test_runs_are_removed_only_with_confirmation(call, root):
    code, lines, _ = call("rm", "prior=smooth")
    assert code == 0
    assert lines[-1] == "6 runs, 0.0 MB: would be removed; --yes removes them"
    assert (root / "sweep" / "0").is_dir()
    assert call("rm", "prior=smooth", "--yes")[0] == 0
    assert not (root / "sweep" / "0").exists()
    assert len(list(root.rglob("summary.json"))) == 7


def test_a_run_that_cannot_be_removed_is_reported_and_the_others_are_removed(call, root):
    with locked(root / "sweep" / "3"):
        code, lines, err = call("rm", "prior=smooth,walking", "--yes")
    assert (code, lines[-1]) == (2, "11 runs, 0.0 MB: removed")
    assert f"workbench runs: {root}/sweep/3: process {os.getpid()} on " in err
    assert sorted(path.name for path in (root / "sweep").iterdir()) == ["3"]


@pytest.mark.parametrize(
    "words", [["no_such_key=3"], ["--sort", "no_such_key"], ["--columns", "no_such_key"], ["path~("], ["a" * 5000]]
)
def test_invalid_queries_are_rejected_with_one_message(call, words):
    code, _, err = call("list", *words)
    assert code == 2
    assert err.startswith("workbench: ")
    assert len(err.splitlines()) == 1


@pytest.fixture
def opened(monkeypatch):
    """The paths of the recordings opened in the viewer."""
    paths = []
    monkeypatch.setattr(view, "view", lambda recordings: paths.extend(map(str, recordings)))
    return paths


def test_the_best_runs_are_opened_in_the_viewer(tmp_path, opened):
    for k, error in enumerate([30.0, 10.0, 20.0]):
        write_recorded_run(tmp_path / str(k), f"run {k}", error=error, day=1 + k)
    for order, expected in (([], "12"), (["--sort", "mpjpe_abs_mm"], "12"), (["--sort=-mpjpe_abs_mm"], "02")):
        assert main(["runs", "list", str(tmp_path), "prior=smooth", *order, "--view", "2"]) == 0
        assert opened == [str(tmp_path / k / "run.rrd") for k in expected]
        opened.clear()
    assert main(["runs", "list", str(tmp_path), "--view", "3"]) == 2  # three do not fit side by side
    assert opened == []


def test_a_list_imports_no_rerun_and_no_hydra(root):
    command = f"main({['runs', 'list', str(root), 'prior=smooth']})"
    code = f"import sys; from workbench.cli.main import main; {command}; print({{'rerun', 'hydra'}} & {{*sys.modules}})"
    process = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert process.stdout.endswith("\nset()\n")


def test_two_configurations_are_compared_in_pairs(tmp_path, capsys):
    for prior, error in (("walking", 40.0), ("smooth", 50.0)):
        for seed in range(3):
            write_recorded_run(
                tmp_path / prior / str(seed), f"{prior}-{seed}", prior=prior, seed=seed, error=error + seed
            )
    for words in (
        [str(tmp_path / "walking"), str(tmp_path / "smooth")],
        ["prior=walking", "prior=smooth", str(tmp_path)],
    ):
        assert main(["runs", "compare", *words, "--csv"]) == 0
        rows = {row["metric"]: row for row in csv.DictReader(StringIO(capsys.readouterr().out))}
        assert float(rows["mpjpe_abs_mm"]["B − A"]) == pytest.approx(10.0)
        assert rows["mpjpe_abs_mm"]["B better"] == "0 of 3"
    assert main(["runs", "compare", str(tmp_path / "walking"), str(tmp_path / "smooth"), "--latex"]) == 0
    assert "\\begin{tabular}" in capsys.readouterr().out
    assert main(["runs", "compare", str(tmp_path), str(tmp_path / "smooth")]) == 2
