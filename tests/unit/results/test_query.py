"""Conditions on runs against what they were told and what they came to."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from run_folders import leave, leave_sweep

from workbench.results.index import entries
from workbench.results.query import chosen, condition, value_of
from workbench.utils.errors import InputError


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    root = tmp_path_factory.mktemp("runs")
    leave_sweep(root / "sweep")
    leave(root / "lost", prior="implicit", status="failed", error=400.0, day=28)
    return entries(root)


@pytest.mark.parametrize(
    ("words", "n"),
    [
        ([], 13),
        (["prior=smooth"], 6),
        (["prior=smooth,implicit"], 7),
        (["prior!=smooth"], 7),
        (["prior=Smooth", "n_particles=400"], 3),
        (["inference.n_particles>=400"], 7),
        (["n_particles>400"], 1),
        (["error_abs_mm<13"], 3),
        (["error_abs_mm<=13", "status=complete"], 4),
        (["status=failed"], 1),
        (["started>2026-11-05"], 9),
        (["started<2026-11-02"], 1),
        (["path~sweep/[0-3]$"], 4),
        (["likelihood.weights.edges>0"], 13),
        (["weights.edges>0.5"], 0),
        (["live=false"], 13),
        (["seed=0", "prior=walking"], 2),
        (["commit~^ccc"], 13),
        (["error_abs_mm<many"], 0),
    ],
)
def test_runs_meet_all_conditions(found, words, n):
    assert len(chosen(found, [condition(word) for word in words])) == n


def test_a_key_that_no_run_has_is_an_error_that_names_near_ones(found):
    with pytest.raises(InputError, match=r"n_particle: no run has .* did you mean n_particles"):
        chosen(found, [condition("n_particle>3")])
    with pytest.raises(InputError, match="expected a regular expression"):
        condition("path~[")


def test_what_is_no_condition_is_a_place():
    assert condition("recordings/runs") is None
    assert condition("..") is None


def test_a_number_that_came_to_nothing_is_none(found):
    assert all(value_of(entry, "log_evidence") is None for entry in found)


@given(st.text(max_size=30))
def test_any_word_is_a_condition_a_place_or_a_sentence(word):
    try:
        made = condition(word)
    except InputError:
        return
    assert made is None or word == made.key + made.sign + made.value
