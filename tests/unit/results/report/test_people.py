"""People repeat an experiment as seeds do."""

import numpy as np
import pytest
from report_runs import made_up

from workbench.results.report.contents import contents, run_csv
from workbench.results.report.groups import group_runs, statistic
from workbench.results.report.people import keys_of_people, person_of

ERRORS = {"35_02": (10.0, 12.0), "35_15": (14.0, 16.0), "38_02": (40.0, 42.0), "39_02": (70.0,)}


def sweep(prior="walking"):
    return [
        made_up(prior, seed=seed, motion=motion, error_abs_mm=error)
        for motion, errors in ERRORS.items()
        for seed, error in enumerate(errors)
    ]


def test_clips_of_several_people_are_one_group_whose_mean_is_over_people():
    (group,) = group_runs(sweep()).groups
    found = statistic(group, "error_abs_mm")
    means = np.array([13.0, 41.0, 70.0])
    assert (found.n, found.people, found.mean) == (7, 3, means.mean())
    assert found.sd_people == pytest.approx(means.std(ddof=1))
    assert found.sd == pytest.approx(np.std([10, 12, 14, 16, 40, 42, 70], ddof=1))
    assert 13.0 <= found.low < found.mean < found.high <= 70.0


def test_a_missing_clip_is_named():
    grouping = group_runs([*sweep(), *sweep("smooth")[:-1]])
    assert [group.label for group in grouping.groups] == ["smooth", "walking"]
    assert grouping.problems == ("smooth: no recording of 39_02, seed 0, which other groups have",)
    assert any("repeated over seeds and 3 people" in line for line in contents(grouping).summary)
    assert ",38,1,error_abs_mm,42.0" in run_csv(grouping)


def test_clips_of_one_person_are_told_apart():
    runs = [made_up(seed=seed, motion=motion, error_px=1.0) for motion in ("35_02", "35_15") for seed in (0, 1)]
    groups = group_runs(runs).groups
    assert [group.values["dataset.motion"] for group in groups] == ["35_02", "35_15"]
    assert [statistic(group, "error_px").people for group in groups] == [1, 1]


def test_a_person_of_whom_nobody_knows_is_told_apart_too():
    assert keys_of_people([{"dataset.motion": "35_02"}, {"dataset.motion": "monday.bvh"}]) == set()
    keys = {"dataset.motion", "prior.base.leave_out"}
    rows = [{"dataset.motion": name, "prior.base.leave_out": [], "seed": 1} for name in ("35_02", "02_01")]
    assert keys_of_people(rows) == keys


@pytest.mark.parametrize(
    ("dataset", "who"),
    [
        ({"motion": "35_02", "seed": 3}, "35"),
        ({"motion": ["35_02", "32_02", "35_15"]}, "35 and 32"),
        ({"motion": "dataset-1_run_active_001"}, "bandai-1"),
        ({"motion": "builtin", "seed": 3}, "generated 3"),
        ({"source": "demo.mp4"}, ""),
        (None, ""),
    ],
)
def test_whom_a_run_shows(dataset, who):
    assert person_of({"dataset": dataset}) == who
