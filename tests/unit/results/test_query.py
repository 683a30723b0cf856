"""Conditions on runs, their order, the columns of a list, and numbers as text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from run_folders import write_run, write_sweep

from workbench.results.query import best_first, listing, parse_condition, select, sort_runs, sweeps, values_of
from workbench.results.table import read_runs
from workbench.utils.errors import InputError


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    root = tmp_path_factory.mktemp("runs")
    write_sweep(root / "sweep")
    write_run(root / "lost", prior="implicit", status="failed", error=400.0, day=28)
    return read_runs(root)


@pytest.mark.parametrize(
    ("words", "n"),
    [
        ("", 13), ("prior=smooth", 6), ("prior=smooth,implicit", 7), ("prior!=smooth", 7),
        ("prior=Smooth n_particles=400", 3), ("inference.n_particles>=400", 7), ("n_particles>400", 1),
        ("mpjpe_abs_mm<13", 3), ("mpjpe_abs_mm<=13 status=complete", 4), ("mpjpe_abs_mm<many", 0),
        ("started>2026-11-05", 9), ("path~sweep/[0-3]$", 4), ("weights.edges>0.5", 0), ("stream=false", 13),
        ("seed=0 prior=walking", 2), ("commit~^ccc", 13),
    ],
)  # fmt: skip
def test_selected_runs_meet_all_conditions(runs, words, n):
    assert len(select(runs, [parse_condition(word) for word in words.split()])) == n


def test_an_unknown_key_is_rejected_with_similar_ones(runs):
    with pytest.raises(InputError, match=r"n_particle: no run has .* did you mean n_particles"):
        select(runs, [("n_particle", ">", "3")])
    with pytest.raises(InputError, match="log_evidence: no run has"):
        values_of(runs, "log_evidence")  # null in every run
    with pytest.raises(InputError, match="expected a regular expression"):
        parse_condition("path~[")


@given(st.text(max_size=30))
def test_any_word_is_a_condition_a_path_or_invalid(word):
    try:
        condition = parse_condition(word)
    except InputError:
        return
    assert condition is None or word == "".join(condition)


def test_runs_are_sorted_numerically_and_the_best_complete_ones_are_first(runs):
    assert values_of(sort_runs(runs, "-mpjpe_abs_mm"), "mpjpe_abs_mm")[:3] == [400.0, 21.0, 20.0]
    assert values_of(best_first(runs), "mpjpe_abs_mm") == [10.0 + k for k in range(12)]


def test_a_listing_omits_empty_columns(runs):
    columns = ["path", "started", "status", "experiment", "varied", "seed", "mpjpe_abs_mm", "coverage_90"]
    assert list(listing(runs, None)) == columns
    assert list(listing(runs[:1], None)) == [name for name in columns if name != "varied"]
    assert listing(runs, ["varied"])["varied"][0] == "implicit, n_particles=500"


def test_a_sweep_is_a_row_with_its_jobs_and_its_best_metric(runs):
    (row,) = sweeps(runs).to_dict("records")
    assert (row["jobs"], row["complete"], row["others"], row["best"]) == (12, 12, "", "mpjpe_abs_mm 10.00")
