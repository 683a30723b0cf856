"""Runs of the protocol of strangers: told by halves, divided by what was shown, and how well doubts tell errors."""

import numpy as np
from report_runs import made_up

from workbench.recording.read.chunks import Curve
from workbench.recording.read.reader import Run
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs
from workbench.results.report.page import as_markdown, terminal
from workbench.results.report.people import person_of

CLIPS = {
    "02_01": ("report", "walk"), "dataset-1_bow_tired_001": ("report", "bow"),
    "05_01": ("choose", "walk"), "dataset-1_bow_happy_001": ("choose", "bow"),
}  # fmt: skip


def run(motion, seed, view_deg, error, doubt=None):
    half, activity = CLIPS[motion]
    made = made_up(seed=seed, motion=motion, error_abs_mm=error, held=float(error < 100.0))
    import yaml

    settings = made.settings
    settings["dataset"] |= {"view_deg": view_deg, "occluder": seed == 1, "first_frame": seed}
    settings["protocol"] = {"half": half, "activity": activity, "shown": "a board" if seed == 1 else "nothing"}
    properties = {**made.properties, "config": {"TextDocument:text": yaml.safe_dump(settings)}}
    frames = np.arange(4)
    curves = {}
    if doubt is not None:
        missed = np.array([500.0, error, error, error])
        curves = {
            name: Curve(frames, values[:, None])
            for name, values in (("doubt_arms_mm", np.array([0.0, doubt, doubt, doubt])), ("missed_arms_mm", missed))
        }
    return Run(made.path, properties, curves)


def sweep():
    errors = iter(range(20, 200, 20))
    return [run(motion, seed, 90.0 * seed, float(next(errors)), 1.0 + seed) for motion in CLIPS for seed in range(2)]


def test_halves_are_groups_and_what_the_hash_drew_is_not():
    groups = group_runs(sweep()).groups
    assert [group.label for group in groups] == ["half=choose", "half=report"]
    assert [len(group.runs) for group in groups] == [4, 4]
    assert all(group.missing == () for group in groups)


def test_a_clip_that_is_missing_is_missed_in_its_own_half():
    problems = group_runs([*sweep()[1:], *[run("02_01", 2, 0.0, 30.0)]]).problems
    assert not any("choose" in problem and "02_01" in problem for problem in problems)


def test_a_style_is_a_person():
    assert person_of(run("dataset-1_bow_tired_001", 0, 0.0, 1.0).settings) == "bandai-tired"
    assert person_of(made_up(motion="dataset-1_bow_tired_001").settings) == "bandai-1"


def test_tables_divide_runs_by_what_was_shown():
    found = contents(group_runs(sweep()))
    titles = [title for title, _ in found.divided]
    assert titles[:3] == [
        "by activity: means over runs",
        "by shown with: means over runs",
        "by camera at: means over runs",
    ]
    rows = {row[:3]: row for row in found.divided[0][1].rows}
    assert rows["half=report", "bow", "2"][found.divided[0][1].header.index("error_abs_mm")] == "70.00"
    assert rows["half=report", "walk", "2"][3] == "1.000"
    assert "They are of these halves of the protocol's clips: choose, report." in found.summary
    for told in (terminal(found), as_markdown("strangers", found, [])):
        assert "by activity" in told
        assert "Spearman" in told


def test_doubts_are_judged_over_all_frames_but_the_given_one():
    (label, joints, n, *_, spearman, area), *_ = contents(group_runs(sweep())).divided[-1][1].rows
    assert (label, joints, n) == ("half=choose", "arms", "12")
    errors, doubts = np.array([100.0, 120.0, 140.0, 160.0]).repeat(3), np.array([1.0, 2.0, 1.0, 2.0]).repeat(3)
    expected = np.corrcoef(np.argsort(np.argsort(errors)) // 3, doubts)[0, 1]
    assert float(spearman) == round(expected, 4)
    assert area == "–"  # all are large


def test_other_runs_are_not_divided():
    assert contents(group_runs([made_up(motion="35_02"), made_up(motion="38_02")])).divided == ()
