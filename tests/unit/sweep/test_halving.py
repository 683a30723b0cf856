"""Successive halving: which jobs go on, and with what."""

from pathlib import Path

import pytest

from workbench.errors import InputError
from workbench.sweep.halving import best_third, frames_of, round_of
from workbench.sweep.plan import Plan

VARIED = tuple((f"x={x}", f"seed={seed}") for x in "abcd" for seed in range(2))
PLAN = Plan(Path("sweep"), None, ("x", "seed"), VARIED, tuple(range(8)))


def test_the_best_third_by_the_mean_over_seeds_goes_on_with_all_its_seeds():
    metrics = dict(enumerate([5.0, 5.0, 1.0, 9.5, 3.0, 4.0, 4.0, 2.0]))  # means 5, 5.25, 3.5, 3
    assert best_third(PLAN, metrics) == [6, 7, 4, 5]
    del metrics[7]  # it failed or was stopped
    assert best_third(PLAN, metrics) == [4, 5, 0, 1]
    assert best_third(PLAN, {}) == []


def test_of_the_jobs_of_a_round_alone():
    few = Plan(PLAN.folder, None, PLAN.keys, VARIED, (2, 3, 6, 7))
    assert best_third(few, {2: 5.0, 3: 5.0, 6: 1.0, 7: 1.0}) == [6, 7]


def test_the_arguments_of_a_round():
    said = ["-m", "x=a,b", "dataset.n_frames=200", "sweep.halving=[3,9]", "hydra.sweep.dir=there"]
    assert round_of(said, "it's", 1, 9, [4, 6]) == [
        "-m", "x=a,b", "dataset.n_frames=9", r"hydra.sweep.dir='it\'s/round_1'", "sweep.jobs=[4,6]",
    ]  # fmt: skip


def test_frames_of_rounds_rise():
    assert frames_of("[10, 50]") == frames_of("'[10,50]'") == [10, 50]
    for text in ("[50,10]", "[10,10]", "[0,10]", "10", "[]", "[a]", "null"):
        with pytest.raises(InputError, match="rising"):
            frames_of(text)


def test_frames_and_rounds_that_no_sweep_has_are_refused_before_the_first():
    for text in ("[1000000000]", "[2,1000001]"):
        with pytest.raises(InputError, match=r"sweep\.halving: expected at most 1000000 frames, found 1"):
            frames_of(text)
    with pytest.raises(InputError, match=r"sweep\.halving: expected at most 1000 rounds, found 1001"):
        frames_of(f"{list(range(1, 1002))}")
    with pytest.raises(InputError, match="rising"):
        frames_of(f"[{'9' * 5000}]")


def test_a_round_of_one_frame_is_refused():
    with pytest.raises(InputError, match=r"sweep\.halving: expected 2 frames or more, .* found \[1,5\]"):
        frames_of("[1,5]")
