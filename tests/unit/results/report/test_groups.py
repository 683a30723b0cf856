"""Groups of runs by their varied keys, statistics over seeds and people, and runs that are not counted."""

import numpy as np
import pytest
import yaml
from fake_runs import fake_run

from workbench.recording.read.chunks import Curve
from workbench.recording.read.reader import Run, Unreadable
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs
from workbench.results.report.people import person_of
from workbench.results.report.variation import flat, label, seeds_of_parts, what_varied

ERRORS = {"35_02": (10.0, 12.0), "35_15": (14.0, 16.0), "38_02": (40.0, 42.0), "39_02": (70.0,)}


def sweep():
    """Return runs of two priors, two numbers of particles and three seeds, not in numerical order."""
    return [
        fake_run(prior, n, seed, mpjpe_abs_mm=float(n + seed + (100 if prior == "smooth" else 0)), zeta=1.0)
        for prior in ("walking", "smooth")
        for n in (1000, 200)
        for seed in (2, 0, 1)
    ]


def people(prior="walking"):
    """Return runs of two seeds and clips of three people."""
    return [
        fake_run(prior, seed=seed, motion=motion, mpjpe_abs_mm=error)
        for motion, errors in ERRORS.items()
        for seed, error in enumerate(errors)
    ]


def statistic(grouping, metric):
    """Return the statistics of a metric of the first group, or None."""
    rows = grouping.statistics[(grouping.statistics["metric"] == metric) & (grouping.statistics["group"] == 0)]
    return next(rows.itertuples(), None)


def test_groups_and_their_runs_are_sorted():
    grouping = group_runs(sweep())
    labels = [f"{prior}, n_particles={n}" for prior in ("smooth", "walking") for n in (200, 1000)]
    assert list(grouping.labels["group"]) == labels
    assert list(grouping.labels["n_particles"]) == ["200", "1000"] * 2
    assert list(grouping.runs["seed"]) == [0, 1, 2] * 4
    assert grouping.problems == ()


def test_statistics_are_over_seeds():
    row = statistic(group_runs(sweep()), "mpjpe_abs_mm")  # 300, 301, 302
    assert (row.n, row.mean, row.sd, row.low_95, row.high_95) == (3, 301.0, 1.0, 300.0, 302.0)
    assert statistic(group_runs(sweep()), "mpjpe_px") is None


def test_a_value_that_is_not_finite_is_not_counted():
    runs = [fake_run(seed=0, mpjpe_px=2.0), fake_run(seed=1, mpjpe_px=np.nan), fake_run(seed=2)]
    row = statistic(group_runs(runs), "mpjpe_px")
    assert (row.n, row.mean) == (1, 2.0)
    assert np.isnan([row.sd, row.low_95, row.high_95]).all()
    assert statistic(group_runs(runs[1:]), "mpjpe_px") is None


def test_clips_of_several_people_form_one_group_with_the_mean_over_people():
    grouping = group_runs(people())
    assert len(grouping.labels) == 1
    row = statistic(grouping, "mpjpe_abs_mm")
    means = np.array([13.0, 41.0, 70.0])
    assert (row.n, row.people, row.mean) == (7, 3, pytest.approx(means.mean()))
    assert row.sd_people == pytest.approx(means.std(ddof=1))
    assert row.sd == pytest.approx(np.std([10, 12, 14, 16, 40, 42, 70], ddof=1))
    assert 13.0 <= row.low_95 < row.mean < row.high_95 <= 70.0


def test_a_missing_clip_is_reported():
    grouping = group_runs([*people(), *people("smooth")[:-1]])
    assert grouping.problems == ("smooth: no recording of 39_02, seed 0, which other groups have",)
    assert any("repeated over seeds and 3 people" in line for line in contents(grouping).summary)
    row = grouping.values[(grouping.values["person"] == "38") & (grouping.values["seed"] == 1)].iloc[0]
    assert (row["metric"], row["value"]) == ("mpjpe_abs_mm", 42.0)


def test_recordings_that_are_not_counted_are_reported():
    runs = [
        fake_run("walking", seed=0, run_id="1"),
        fake_run("walking", seed=1, status="failed"),
        fake_run("walking", seed=2, status="running"),
        fake_run("smooth", seed=0, run_id="1", mpjpe_px=1.0),
        fake_run("smooth", seed=0, run_id="2", mpjpe_px=2.0),
        fake_run("smooth", seed=0, status="failed"),
        fake_run("smooth", seed=3),
        fake_run("smooth", seed="one"),
    ]
    damaged = Unreadable("damaged.rrd", "damaged.rrd: expected a recording")
    grouping = group_runs(runs, [damaged])
    assert list(grouping.values["value"]) == [2.0]  # the later of two
    for problem, text in zip(grouping.problems, (
        "smooth, seed 0: failed", "smooth, seed 0: recorded more than once", "smooth: no recording of seed 1, 2",
        "walking, seed 1: failed", "walking, seed 2: cut off", "walking: no recording of seed 3", "damaged.rrd",
        "found 'one'",
    ), strict=True):  # fmt: skip
        assert text in problem
    summary = contents(grouping).summary
    assert summary[0] == "9 recordings: 4 complete, 2 failed, 1 cut off or still running, 2 unreadable."


CLIPS = {
    "02_01": ("test", "walk"), "dataset-1_bow_tired_001": ("test", "bow"),
    "05_01": ("validation", "walk"), "dataset-1_bow_happy_001": ("validation", "bow"),
}  # fmt: skip


def run(motion, seed, view_azimuth_deg, error):
    """Return a run of a protocol with an expected error of 1 + seed mm in every frame."""
    split, activity = CLIPS[motion]
    fake = fake_run(seed=seed, motion=motion, mpjpe_abs_mm=error, tracked=float(error < 100.0))
    settings = fake.settings
    settings["dataset"] |= {"view_azimuth_deg": view_azimuth_deg, "occluder": seed == 1, "first_frame": seed}
    settings["protocol"] = {"split": split, "activity": activity, "occlusion": "a board" if seed == 1 else "nothing"}
    properties = {**fake.properties, "config": {"TextDocument:text": yaml.safe_dump(settings)}}
    series = {"expected_error_arms_mm": [0.0, *[1.0 + seed] * 3], "mpjpe_abs_arms_mm": [500.0, error, error, error]}
    curves = {name: Curve(np.arange(4), np.array(values)[:, None]) for name, values in series.items()}
    return Run(fake.path, properties, curves)


@pytest.fixture
def protocol_runs():
    errors = iter(range(20, 200, 20))
    return [run(motion, seed, 90.0 * seed, float(next(errors))) for motion in CLIPS for seed in range(2)]


def test_splits_are_groups_and_random_choices_of_a_protocol_are_not(protocol_runs):
    grouping = group_runs(protocol_runs)
    assert list(grouping.labels["group"]) == ["split=test", "split=validation"]
    assert list(grouping.runs["group"]) == [0] * 4 + [1] * 4
    assert grouping.problems == ()
    problems = group_runs([*protocol_runs[1:], run("02_01", 2, 0.0, 30.0)]).problems
    assert not any("validation" in problem and "02_01" in problem for problem in problems)  # a clip of the test split


def test_expected_errors_are_evaluated_in_all_frames_but_the_first(protocol_runs):
    tables = contents(group_runs(protocol_runs)).tables
    title, table = next((title, table) for title, table in tables.items() if "expected" in title)
    assert title.endswith("those over 50 mm")
    row = table[table["group"] == "split=validation"].iloc[0]
    assert tuple(row[["group", "joints", "frames"]]) == ("split=validation", "arms", 12)
    errors, expected_errors = np.array([100.0, 120.0, 140.0, 160.0]).repeat(3), np.array([1.0, 2.0, 1.0, 2.0]).repeat(3)
    correlation = np.corrcoef(np.argsort(np.argsort(errors)) // 3, expected_errors)[0, 1]
    assert row["Spearman"] == pytest.approx(correlation)
    assert np.isnan(row["AUC"])  # all errors are large


@pytest.mark.parametrize(
    ("settings", "person"),
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
def test_the_person_of_a_run(settings, person):
    assert person_of(settings) == person


WALKING = {"_target_": "workbench.priors.from_motions.walking", "motions": "builtin", "variance": 0.95}
SMOOTH = {"_target_": "workbench.priors.smooth.Smooth", "damping": 0.0}


def settings(prior=WALKING, n=500, experiment="custom", **keys):
    return flat({"prior": prior, "inference": {"n_particles": n}, "seed": 0, **keys}, experiment)


def test_the_varied_keys_are_a_choice_and_a_number():
    # the keys of the priors follow from the choice
    varied = what_varied([settings(prior, n) for prior in (WALKING, SMOOTH) for n in (500, 5000)])
    assert (varied.keys, varied.following) == (("prior._target_", "inference.n_particles"), ())
    assert label(varied.keys, settings(SMOOTH, 500)) == "smooth, n_particles=500"
    assert label(varied.keys, settings(WALKING, 5000)) == "walking, n_particles=5000"


def test_a_label_has_the_keys_of_its_own_choice():
    tuned = [WALKING, {**WALKING, "variance": 0.8}, SMOOTH]
    varied = what_varied([settings(prior) for prior in tuned])
    assert varied.keys == ("prior._target_", "prior.variance")
    assert [label(varied.keys, settings(prior)) for prior in tuned] == [
        "walking, variance=0.95", "walking, variance=0.8", "smooth",
    ]  # fmt: skip


def test_keys_without_effect_on_the_results_are_not_varied():
    def keys_without_effect(name):
        paths = {"data": f"/{name}", "cache": f"/{name}"}
        recorder = {"stream": name == "a"}
        return {"paths": paths, "n_threads": len(name), "recorder": recorder, "dataset": paths, "seed": name}

    assert what_varied([settings(**keys_without_effect("a")), settings(**keys_without_effect("bb"))]).keys == ()
    assert flat({"recorder.stream": True, "seed": 3, "a.b": 1}, "x") == {"experiment": "x", "a.b": 1}


def test_a_components_seed_is_a_repetition_where_it_equals_the_runs_seed():
    runs = [settings(dataset={"seed": seed}, likelihood={"seed": 0}) for seed in (0, 1)]
    assert seeds_of_parts(runs, [0, 1]) == {"dataset.seed"}
    assert seeds_of_parts(runs, [0, 2]) == set()


def test_keys_that_follow_from_an_experiment_or_a_motion_are_not_varied():
    varied = what_varied([settings(n=n, experiment=name) for name, n in (("walk_straight", 500), ("walk_circle", 900))])
    assert (varied.keys, varied.following) == (("experiment",), ("inference.n_particles",))
    motions = [
        settings({**WALKING, "exclude": [motion]}, dataset={"motion": motion, "view_azimuth_deg": view})
        for motion, view in (("35_02", 30.0), ("07_01", 60.0), ("16_15", 30.0))
    ]
    varied = what_varied(motions)
    assert (varied.keys, varied.following) == (("dataset.motion",), ("prior.exclude", "dataset.view_azimuth_deg"))
