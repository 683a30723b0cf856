"""Two configurations are compared in pairs of equal clips and seeds."""

import numpy as np
import pytest
from fake_runs import fake_run

from workbench.results.report.pairs import hierarchical_interval, paired_table
from workbench.utils.errors import InputError

RNG = np.random.default_rng(0)
MOTIONS = ("02_01", "05_01", "06_01", "07_01", "08_01", "16_15")


def runs(prior, error, motions=MOTIONS, seeds=range(3)):
    return [fake_run(prior, seed=seed, motion=motion, mpjpe_px=error(motion, seed), tracked=1.0)
            for motion in motions for seed in seeds]  # fmt: skip


def difficulty(motion, seed):
    return 10.0 * MOTIONS.index(motion) + 0.1 * seed


def test_a_small_difference_is_found_among_people_of_different_difficulty():
    a, b = (
        runs("walking", difficulty),
        runs("smooth", lambda *pair: difficulty(*pair) - 0.5 + 0.1 * RNG.standard_normal()),
    )
    row = paired_table(a, b).set_index("metric").loc["mpjpe_px"]
    assert row["pairs"] == 18
    assert row["B better"] == "18 of 18"
    assert -0.65 < row["low_90"] < row["B − A"] < row["high_90"] < -0.35
    assert row["significant"]
    assert row["effect"] < -3.0


def test_equal_runs_do_not_differ():
    table = paired_table(runs("walking", difficulty), runs("smooth", difficulty)).set_index("metric")
    assert (table["B − A"] == 0.0).all()
    assert not table["significant"].any()


def test_only_common_clips_and_seeds_are_compared():
    a, b = runs("walking", difficulty, MOTIONS[:3]), runs("smooth", difficulty, MOTIONS[1:], range(1, 5))
    assert (paired_table(a, b)["pairs"] == 4).all()
    with pytest.raises(InputError, match="equal clips and seeds"):
        paired_table(a, runs("smooth", difficulty, MOTIONS[3:]))


def test_several_configurations_on_one_side_are_refused():
    a, b = runs("walking", difficulty), runs("smooth", difficulty)
    with pytest.raises(InputError, match=r"A: .*smooth; walking"):
        paired_table([*a, *b], b)
    with pytest.raises(InputError, match="B: "):
        paired_table(a, [])


def test_intervals_cover_the_mean_over_people_and_their_seeds():
    """People differ by 1, and seeds by 1: 90 % of the intervals contain the mean; of seeds alone, 66 % would."""
    covered, rng = 0, np.random.default_rng(1)
    for _ in range(200):
        people = [rng.normal() + rng.standard_normal(3) for _ in range(12)]
        low, high = hierarchical_interval(people, rng)
        covered += low <= 0.0 <= high
    assert 0.84 <= covered / 200 <= 0.97  # three standard deviations of a count of 200


def test_a_single_pair_has_no_interval():
    assert np.isnan(hierarchical_interval([np.array([1.0])], RNG)).all()
    assert np.isfinite(hierarchical_interval([np.array([1.0, 2.0])], RNG)).all()
    assert np.isfinite(hierarchical_interval([np.array([1.0]), np.array([2.0])], RNG)).all()
