"""Runs in groups: which keys tell them apart, their statistics over seeds and people, and what does not count."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from workbench.recording.read.chunks import Curve
from workbench.recording.read.reader import Run, Unreadable
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs
from workbench.results.report.people import person_of
from workbench.results.report.variation import flat, label, seeds_of_parts, what_varied


def made_up(
    prior: str = "walking",
    n: int = 500,
    seed: Any = 0,
    status: str = "complete",
    cost: dict[str, float] | None = None,
    study: bool = False,
    run_id: str = "",
    version: str = "1",
    motion: Any = None,
    **metrics: float,
) -> Run:
    """A run of `prior` with n particles, which leaves out whoever is in `motion`; its metrics by name."""
    config: dict[str, Any] = {
        "prior": {"_target_": f"workbench.priors.{prior}"},
        "inference": {"n_particles": n},
        "seed": seed,
    }
    if motion is not None:
        config["dataset"] = {"motion": motion, "seed": seed}
        config["prior"]["exclude"] = [str(motion)[:2]]
    properties: dict[str, dict[str, Any]] = {
        "run": {"status": status, "id": run_id},
        "config": {"TextDocument:text": yaml.safe_dump(config)},
        "provenance": {"experiment": "custom", "workbench": version},
        "metrics": metrics,
        "cost": cost or {},
    }
    if not study:
        properties["body"] = {"joints": ["pelvis"], "pose": ["root_x"]}
    return Run(
        Path(f"{prior}_{n}_{seed}_{status}.rrd" if motion is None else f"{prior}_{motion}_{seed}.rrd"), properties, {}
    )


ERRORS = {"35_02": (10.0, 12.0), "35_15": (14.0, 16.0), "38_02": (40.0, 42.0), "39_02": (70.0,)}


def sweep():
    """Two priors, two numbers of particles, three seeds; paths in another order than the numbers."""
    return [
        made_up(prior, n, seed, mpjpe_abs_mm=float(n + seed + (100 if prior == "smooth" else 0)), zeta=1.0)
        for prior in ("walking", "smooth")
        for n in (1000, 200)
        for seed in (2, 0, 1)
    ]


def people(prior="walking"):
    """Two seeds of clips of three people."""
    return [
        made_up(prior, seed=seed, motion=motion, mpjpe_abs_mm=error)
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
    found = statistic(group_runs(sweep()), "mpjpe_abs_mm")  # 300, 301, 302
    assert (found.n, found.mean, found.sd, found.low_95, found.high_95) == (3, 301.0, 1.0, 300.0, 302.0)
    assert statistic(group_runs(sweep()), "mpjpe_px") is None


def test_a_value_that_is_not_finite_is_not_counted():
    runs = [made_up(seed=0, mpjpe_px=2.0), made_up(seed=1, mpjpe_px=np.nan), made_up(seed=2)]
    found = statistic(group_runs(runs), "mpjpe_px")
    assert (found.n, found.mean) == (1, 2.0)
    assert np.isnan([found.sd, found.low_95, found.high_95]).all()
    assert statistic(group_runs(runs[1:]), "mpjpe_px") is None


def test_clips_of_several_people_are_one_group_whose_mean_is_over_people():
    grouping = group_runs(people())
    assert len(grouping.labels) == 1
    found = statistic(grouping, "mpjpe_abs_mm")
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
    assert (row["metric"], row["value"]) == ("mpjpe_abs_mm", 42.0)


def test_everything_that_does_not_count_is_named():
    runs = [
        made_up("walking", seed=0, run_id="1"),
        made_up("walking", seed=1, status="failed"),
        made_up("walking", seed=2, status="running"),
        made_up("smooth", seed=0, run_id="1", mpjpe_px=1.0),
        made_up("smooth", seed=0, run_id="2", mpjpe_px=2.0),
        made_up("smooth", seed=0, status="failed"),
        made_up("smooth", seed=3),
        made_up("smooth", seed="one"),
    ]
    torn = Unreadable("torn.rrd", "torn.rrd: expected a whole recording")
    grouping = group_runs(runs, [torn])
    assert list(grouping.values["value"]) == [2.0]  # the later of two
    for problem, words in zip(grouping.problems, (
        "smooth, seed 0: failed", "smooth, seed 0: recorded more than once", "smooth: no recording of seed 1, 2",
        "walking, seed 1: failed", "walking, seed 2: cut off", "walking: no recording of seed 3", "torn.rrd",
        "found 'one'",
    ), strict=True):  # fmt: skip
        assert words in problem
    summary = contents(grouping).summary
    assert summary[0] == "9 recordings: 4 complete, 2 failed, 1 cut off or still running, 2 unreadable."


CLIPS = {
    "02_01": ("test", "walk"), "dataset-1_bow_tired_001": ("test", "bow"),
    "05_01": ("validation", "walk"), "dataset-1_bow_happy_001": ("validation", "bow"),
}  # fmt: skip


def run(motion, seed, view_azimuth_deg, error):
    """A run of a protocol whose doubt is 1 + seed mm in every frame."""
    half, activity = CLIPS[motion]
    made = made_up(seed=seed, motion=motion, mpjpe_abs_mm=error, tracked=float(error < 100.0))
    settings = made.settings
    settings["dataset"] |= {"view_azimuth_deg": view_azimuth_deg, "occluder": seed == 1, "first_frame": seed}
    settings["protocol"] = {"split": half, "activity": activity, "occlusion": "a board" if seed == 1 else "nothing"}
    properties = {**made.properties, "config": {"TextDocument:text": yaml.safe_dump(settings)}}
    series = {"expected_error_arms_mm": [0.0, *[1.0 + seed] * 3], "mpjpe_abs_arms_mm": [500.0, error, error, error]}
    curves = {name: Curve(np.arange(4), np.array(values)[:, None]) for name, values in series.items()}
    return Run(made.path, properties, curves)


@pytest.fixture
def protocol_runs():
    errors = iter(range(20, 200, 20))
    return [run(motion, seed, 90.0 * seed, float(next(errors))) for motion in CLIPS for seed in range(2)]


def test_halves_are_groups_and_what_a_protocol_drew_is_not(protocol_runs):
    grouping = group_runs(protocol_runs)
    assert list(grouping.labels["group"]) == ["split=test", "split=validation"]
    assert list(grouping.runs["group"]) == [0] * 4 + [1] * 4
    assert grouping.problems == ()
    problems = group_runs([*protocol_runs[1:], run("02_01", 2, 0.0, 30.0)]).problems
    assert not any("validation" in problem and "02_01" in problem for problem in problems)  # of the test split only


def test_doubts_are_judged_over_all_frames_but_the_given_one(protocol_runs):
    title, table = next(each for each in contents(group_runs(protocol_runs)).tables.items() if "expected" in each[0])
    assert title.endswith("those over 50 mm")
    row = table[table["group"] == "split=validation"].iloc[0]
    assert tuple(row[["group", "joints", "frames"]]) == ("split=validation", "arms", 12)
    errors, doubts = np.array([100.0, 120.0, 140.0, 160.0]).repeat(3), np.array([1.0, 2.0, 1.0, 2.0]).repeat(3)
    expected = np.corrcoef(np.argsort(np.argsort(errors)) // 3, doubts)[0, 1]
    assert row["Spearman"] == pytest.approx(expected)
    assert np.isnan(row["AUC"])  # all are large


@pytest.mark.parametrize(
    ("settings", "who"),
    [
        ({"dataset": {"motion": "35_02", "seed": 3}}, "35"),
        ({"dataset": {"motion": ["35_02", "32_02", "35_15"]}}, "35 and 32"),
        ({"dataset": {"motion": "dataset-1_bow_tired_001"}}, "bandai-1"),
        ({"dataset": {"motion": "dataset-1_bow_tired_001"}, "protocol": {"split": "test"}}, "bandai-1"),
        ({"dataset": {"motion": "builtin", "seed": 3}}, "generated 3"),
        ({"dataset": {"source": "demo.mp4"}}, ""),
        ({"dataset": None}, ""),
    ],
)
def test_whom_a_run_shows(settings, who):
    assert person_of(settings) == who


WALKING = {"_target_": "workbench.priors.from_motions.walking", "motions": "builtin", "variance": 0.95}
SMOOTH = {"_target_": "workbench.priors.smooth.Smooth", "damping": 0.0}


def settings(prior=WALKING, n=500, experiment="custom", **more):
    return flat({"prior": prior, "inference": {"n_particles": n}, "seed": 0, **more}, experiment)


def test_a_choice_and_a_number_are_what_varied():
    # every key of either prior differs too, but follows the choice
    found = what_varied([settings(prior, n) for prior in (WALKING, SMOOTH) for n in (500, 5000)])
    assert (found.keys, found.following) == (("prior._target_", "inference.n_particles"), ())
    assert label(found.keys, settings(SMOOTH, 500)) == "smooth, n_particles=500"
    assert label(found.keys, settings(WALKING, 5000)) == "walking, n_particles=5000"


def test_a_key_of_one_choice_only_is_left_out_of_the_others_label():
    tuned = [WALKING, {**WALKING, "variance": 0.8}, SMOOTH]
    found = what_varied([settings(prior) for prior in tuned])
    assert found.keys == ("prior._target_", "prior.variance")
    assert [label(found.keys, settings(prior)) for prior in tuned] == [
        "walking, variance=0.95", "walking, variance=0.8", "smooth",
    ]  # fmt: skip


def test_what_cannot_change_the_numbers_is_no_difference():
    def places(name):
        paths = {"data": f"/{name}", "cache": f"/{name}"}
        return {
            "paths": paths,
            "n_threads": len(name),
            "recorder": {"stream": name == "a"},
            "dataset": paths,
            "seed": name,
        }

    assert what_varied([settings(**places("a")), settings(**places("bb"))]).keys == ()
    assert flat({"recorder.stream": True, "seed": 3, "a.b": 1}, "x") == {"experiment": "x", "a.b": 1}  # of a table


def test_a_parts_seed_repeats_only_where_it_is_the_runs_own():
    own = [settings(dataset={"seed": seed}, likelihood={"seed": 0}) for seed in (0, 1)]
    assert seeds_of_parts(own, [0, 1]) == {"dataset.seed"}
    assert seeds_of_parts(own, [0, 2]) == set()


def test_what_an_experiment_or_a_motion_brings_with_it_follows():
    found = what_varied([settings(n=n, experiment=name) for name, n in (("walk_straight", 500), ("walk_circle", 900))])
    assert (found.keys, found.following) == (("experiment",), ("inference.n_particles",))
    motions = [
        settings({**WALKING, "exclude": [motion]}, dataset={"motion": motion, "view_azimuth_deg": view})
        for motion, view in (("35_02", 30.0), ("07_01", 60.0), ("16_15", 30.0))
    ]
    found = what_varied(motions)
    assert (found.keys, found.following) == (("dataset.motion",), ("prior.exclude", "dataset.view_azimuth_deg"))
