"""People repeat an experiment as seeds do, and the runs of a protocol divide by what was shown."""

import numpy as np
import pytest
import yaml
from report_runs import made_up

from workbench.recording.read.chunks import Curve
from workbench.recording.read.reader import Run
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs
from workbench.results.report.people import keys_of_people, person_of

CLIPS = {
    "02_01": ("report", "walk"), "dataset-1_bow_tired_001": ("report", "bow"),
    "05_01": ("choose", "walk"), "dataset-1_bow_happy_001": ("choose", "bow"),
}  # fmt: skip


def run(motion, seed, view_deg, error):
    """A run of a protocol whose doubt is 1 + seed mm in every frame."""
    half, activity = CLIPS[motion]
    made = made_up(seed=seed, motion=motion, error_abs_mm=error, held=float(error < 100.0))
    settings = made.settings
    settings["dataset"] |= {"view_deg": view_deg, "occluder": seed == 1, "first_frame": seed}
    settings["protocol"] = {"half": half, "activity": activity, "shown": "a board" if seed == 1 else "nothing"}
    properties = {**made.properties, "config": {"TextDocument:text": yaml.safe_dump(settings)}}
    series = {"doubt_arms_mm": [0.0, *[1.0 + seed] * 3], "missed_arms_mm": [500.0, error, error, error]}
    curves = {name: Curve(np.arange(4), np.array(values)[:, None]) for name, values in series.items()}
    return Run(made.path, properties, curves)


@pytest.fixture
def sweep():
    errors = iter(range(20, 200, 20))
    return [run(motion, seed, 90.0 * seed, float(next(errors))) for motion in CLIPS for seed in range(2)]


def test_halves_are_groups_and_what_a_protocol_drew_is_not(sweep):
    grouping = group_runs(sweep)
    assert list(grouping.labels["group"]) == ["half=choose", "half=report"]
    assert list(grouping.runs["group"]) == [0] * 4 + [1] * 4
    assert grouping.problems == ()
    problems = group_runs([*sweep[1:], run("02_01", 2, 0.0, 30.0)]).problems
    assert not any("choose" in problem and "02_01" in problem for problem in problems)  # missing in its own half only


def test_doubts_are_judged_over_all_frames_but_the_given_one(sweep):
    title, table = next(each for each in contents(group_runs(sweep)).tables.items() if "doubt" in each[0])
    assert title.endswith("those over 50 mm")
    row = table.iloc[0]
    assert tuple(row[["group", "joints", "frames"]]) == ("half=choose", "arms", 12)
    errors, doubts = np.array([100.0, 120.0, 140.0, 160.0]).repeat(3), np.array([1.0, 2.0, 1.0, 2.0]).repeat(3)
    expected = np.corrcoef(np.argsort(np.argsort(errors)) // 3, doubts)[0, 1]
    assert row["Spearman"] == pytest.approx(expected)
    assert np.isnan(row["AUC"])  # all are large


def test_a_motion_of_an_unknown_person_is_told_apart():
    assert keys_of_people([{"dataset.motion": "35_02"}, {"dataset.motion": "monday.bvh"}]) == set()
    keys = {"dataset.motion", "prior.base.leave_out"}
    rows = [{"dataset.motion": name, "prior.base.leave_out": [], "seed": 1} for name in ("35_02", "02_01")]
    assert keys_of_people(rows) == keys


@pytest.mark.parametrize(
    ("settings", "who"),
    [
        ({"dataset": {"motion": "35_02", "seed": 3}}, "35"),
        ({"dataset": {"motion": ["35_02", "32_02", "35_15"]}}, "35 and 32"),
        ({"dataset": {"motion": "dataset-1_bow_tired_001"}}, "bandai-1"),
        ({"dataset": {"motion": "dataset-1_bow_tired_001"}, "protocol": {"half": "report"}}, "bandai-tired"),
        ({"dataset": {"motion": "builtin", "seed": 3}}, "generated 3"),
        ({"dataset": {"source": "demo.mp4"}}, ""),
        ({"dataset": None}, ""),
    ],
)
def test_whom_a_run_shows(settings, who):
    assert person_of(settings) == who
