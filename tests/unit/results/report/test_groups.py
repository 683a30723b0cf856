"""Runs in groups, their statistics, and what is said about those that do not count."""

import numpy as np
import pytest
from report_runs import made_up

from workbench.recording.read.reader import Unreadable
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs

ERRORS = {"35_02": (10.0, 12.0), "35_15": (14.0, 16.0), "38_02": (40.0, 42.0), "39_02": (70.0,)}


def sweep():
    """Two priors, two numbers of particles, three seeds; paths in another order than the numbers."""
    return [
        made_up(prior, n, seed, error_abs_mm=float(n + seed + (100 if prior == "smooth" else 0)), zeta=1.0)
        for prior in ("walking", "smooth")
        for n in (1000, 200)
        for seed in (2, 0, 1)
    ]


def people(prior="walking"):
    """Two seeds of clips of three people."""
    return [
        made_up(prior, seed=seed, motion=motion, error_abs_mm=error)
        for motion, errors in ERRORS.items()
        for seed, error in enumerate(errors)
    ]


def statistic(grouping, metric):
    """The statistics of a metric of the first group; None where it has none."""
    rows = grouping.statistics[(grouping.statistics["metric"] == metric) & (grouping.statistics["group"] == 0)]
    return next(rows.itertuples(), None)


def test_groups_are_ordered_and_their_runs_too():
    grouping = group_runs(sweep())
    labels = [f"{prior}, n_particles={n}" for prior in ("smooth", "walking") for n in (200, 1000)]
    assert list(grouping.labels["group"]) == labels
    assert list(grouping.labels["n_particles"]) == ["200", "1000"] * 2
    assert list(grouping.runs["seed"]) == [0, 1, 2] * 4
    assert grouping.problems == ()


def test_statistics_are_those_of_the_seeds():
    found = statistic(group_runs(sweep()), "error_abs_mm")  # 300, 301, 302
    assert (found.n, found.mean, found.sd, found.low_95, found.high_95) == (3, 301.0, 1.0, 300.0, 302.0)
    assert statistic(group_runs(sweep()), "error_px") is None


def test_a_value_that_is_not_finite_is_not_counted():
    runs = [made_up(seed=0, error_px=2.0), made_up(seed=1, error_px=np.nan), made_up(seed=2)]
    found = statistic(group_runs(runs), "error_px")
    assert (found.n, found.mean) == (1, 2.0)
    assert np.isnan([found.sd, found.low_95, found.high_95]).all()
    assert statistic(group_runs(runs[1:]), "error_px") is None


def test_clips_of_several_people_are_one_group_whose_mean_is_over_people():
    grouping = group_runs(people())
    assert len(grouping.labels) == 1
    found = statistic(grouping, "error_abs_mm")
    means = np.array([13.0, 41.0, 70.0])
    assert (found.n, found.people, found.mean) == (7, 3, pytest.approx(means.mean()))
    assert found.sd_people == pytest.approx(means.std(ddof=1))
    assert found.sd == pytest.approx(np.std([10, 12, 14, 16, 40, 42, 70], ddof=1))
    assert 13.0 <= found.low_95 < found.mean < found.high_95 <= 70.0


def test_a_missing_clip_is_named():
    grouping = group_runs([*people(), *people("smooth")[:-1]])
    assert grouping.problems == ("smooth: no recording of 39_02, seed 0, which other groups have",)
    assert any("repeated over seeds and 3 people" in line for line in contents(grouping).summary)
    row = grouping.values[(grouping.values["person"] == "38") & (grouping.values["seed"] == 1)].iloc[0]
    assert (row["metric"], row["value"]) == ("error_abs_mm", 42.0)


def test_clips_of_one_person_are_told_apart():
    runs = [made_up(seed=seed, motion=motion, error_px=1.0) for motion in ("35_02", "35_15") for seed in (0, 1)]
    assert list(group_runs(runs).labels["motion"]) == ["35_02", "35_15"]


def test_everything_that_does_not_count_is_named():
    runs = [
        made_up("walking", seed=0, run_id="1"),
        made_up("walking", seed=1, status="failed"),
        made_up("walking", seed=2, status="running"),
        made_up("smooth", seed=0, run_id="1", error_px=1.0),
        made_up("smooth", seed=0, run_id="2", error_px=2.0),
        made_up("smooth", seed=0, status="failed"),
        made_up("smooth", seed=3),
        made_up("smooth", seed="one"),
    ]
    torn = Unreadable("torn.rrd", "torn.rrd: expected a whole recording")
    grouping = group_runs(runs, [torn])
    assert list(grouping.values["value"]) == [2.0]  # the later of two
    assert grouping.problems == (
        "smooth, seed 0: failed, not counted; a complete one is there (smooth_500_0_failed.rrd)",
        "smooth, seed 0: recorded more than once, not counted again (smooth_500_0_complete.rrd)",
        "smooth: no recording of seed 1, 2, which other groups have",
        "walking, seed 1: failed, not counted (walking_500_1_failed.rrd)",
        "walking, seed 2: cut off or still running, not counted (walking_500_2_running.rrd)",
        "walking: no recording of seed 3, which other groups have",
        "not a recording that can be read: torn.rrd: expected a whole recording",
        "not a recording that can be read: smooth_500_one_complete.rrd: expected a configuration with a whole number "
        "as its seed, found 'one'",
    )
    summary = contents(grouping).summary
    assert summary[0] == "9 recordings: 4 complete, 2 failed, 1 cut off or still running, 2 unreadable."


@pytest.mark.parametrize("runs", [[], [made_up(status="failed")]])
def test_nothing_complete_is_no_error(runs):
    found = contents(group_runs(runs))
    assert (found.tables, found.others) == ({}, {})
