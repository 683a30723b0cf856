"""Whom experiments are run over, and numbers over people: known means and deviations, lists by what is shown."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from analysis.figures import people, replicates
from analysis.figures.recordings import Source
from workbench.errors import InputError
from workbench.mocap.names import performer

CONFIG = Path(__file__).parents[3] / "conf" / "config.yaml"
ACTIVITIES = {"walk": "35_02", "run": "02_03", "byebye": "dataset-1_byebye_giant_001"}
FRAMES = {"07_01": 37, "02_03": 21, "02_01": 40}


@pytest.fixture(autouse=True)
def nothing_is_read(monkeypatch):
    """Motions have an activity and as many frames as are said above, or 60."""

    def found(config, name):
        class Named:
            activity = next((activity for activity, clip in ACTIVITIES.items() if clip == name), "walk")

            def __len__(self):
                return FRAMES.get(name, 60)

        return Named()

    monkeypatch.setattr(people, "_motion", found)


def showing(motion, **dataset):
    """A configuration of a dataset that shows a motion, with the lists of the true one."""
    lists = OmegaConf.load(CONFIG).clips
    dataset = {"motion": motion, "n_frames": 28, "first_frame": 10, "rate_hz": 14.0, **dataset}
    return OmegaConf.create({"dataset": dataset, "clips": lists, "paths": {"data": "somewhere"}})


def test_means_are_over_people_and_so_is_the_deviation():
    runs = {("a",): [{"error_abs_mm": 10.0, "held": 1.0}, {"error_abs_mm": 30.0, "held": 0.0}]}
    alone = people.OverPeople(runs)
    assert (alone.spread("error_abs_mm")[0], alone.held) == (20.0, (1, 2))
    assert np.isnan(alone.spread("error_abs_mm")[1])
    both = people.OverPeople(runs | {("b",): [{"error_abs_mm": 50.0, "held": 1.0}]})  # a seed less weighs no less
    assert both.spread("error_abs_mm") == (35.0, pytest.approx(15.0 * np.sqrt(2.0)))
    assert (both.told("error_abs_mm"), both.told("knee_deg"), both.held) == ("35 ± 21 mm", "", (2, 3))
    angles = people.OverPeople({("a",): [{"knee_deg": 4.0, "coverage_90": 0.5}], ("b",): [{"knee_deg": 6.0}]})
    assert (angles.told("knee_deg"), angles.told("coverage_90")) == ("5.0 ± 1.4°", "")  # what all of them have
    assert list(people.table({("walk_best", "ours"): both}))[-1] == (
        "| walk_best | ours | 2 | 2 of 3 | 35 ± 21 mm |  |  |  |  |"
    )


@pytest.mark.parametrize(
    ("motion", "others", "name"),
    [
        ("35_02", {}, "report"),
        ("02_03", {}, "report_run"),
        (["35_02", "02_03"], {}, "report_walk_run"),
        ("35_02", {"skeleton": "full"}, "report_full"),
    ],
)
def test_an_experiment_goes_through_people_who_do_what_it_shows(motion, others, name):
    config = showing(motion, **others)
    listed = [[each] if isinstance(each, str) else list(each) for each in config.clips[name]]
    found = people.report_clips(config)
    assert [list(clips) for clips in found] == listed
    everybody = [performer(clips[0]) for clips in found]
    assert len(set(everybody)) == len(everybody)
    assert all(performer(clip) == who for clips, who in zip(found, everybody, strict=True) for clip in clips)


@pytest.mark.parametrize(
    ("motion", "path", "sentence"),
    [
        ("builtin", "straight", "people: builtin of the dataset is generated, expected a recorded motion"),
        ("35_02", "circle", "is generated, expected a recorded motion"),
        ("dataset-1_byebye_giant_001", "straight", "shows byebye, of which no clips are to report"),
        (["02_03", "35_02"], "straight", "shows run, walk, of which no clips are to report"),
    ],
)
def test_what_nobody_to_report_does_is_refused(motion, path, sentence):
    with pytest.raises(InputError, match=sentence):
        people.report_clips(showing(motion, path=path))


def test_a_clip_that_is_too_short_begins_earlier_and_is_cut():
    points = showing("35_02")
    for clip, n_frames, first in (("05_01", 28, 10), ("07_01", 28, 9), ("02_03", 21, 0)):
        assert people.shown(points, (clip,)) == [
            f"dataset.motion='{clip}'", f"dataset.n_frames={n_frames}", f"dataset.first_frame={first}",
        ]  # fmt: skip
    pair = people.shown(points, ("02_01", "02_03"))  # half a blend, 2.1 frames, longer than 14 frames each
    assert pair == ["dataset.motion=['02_01','02_03']", "dataset.n_frames=28", "dataset.first_frame=10"]
    points.dataset.n_frames = 42
    assert people.shown(points, ("02_01", "02_03"))[1:] == ["dataset.n_frames=36", "dataset.first_frame=10"]


def test_everybody_is_run_once_with_seeds_of_their_own(monkeypatch, tmp_path):
    seen = []

    def composed(overrides):
        given = [each for each in overrides if each.startswith(("seed=", "dataset."))]
        return OmegaConf.merge(showing("35_02", seed=0), {"seed": 0}, OmegaConf.from_dotlist(given))

    def run(config, experiment):
        seen.append((config.dataset.motion.strip("'"), config.seed, config.dataset.seed))
        return {"held": 1.0, "error_abs_mm": float(config.seed)}

    monkeypatch.setattr(replicates, "_run", run)
    monkeypatch.setattr(replicates, "composed", composed)
    source = Source(tmp_path, "somewhere", quick=True)
    for _ in range(2):  # what is kept is not run again
        found = replicates.over_people("walk_straight", "ours", source, n_seeds=2)
    expected = [(k, seed) for k in range(len(found.runs)) for seed in (0, 1)]
    assert [own for _, *own in seen] == [[100 * k + seed, 1000 + 100 * k + seed] for k, seed in expected]
    assert [motion for motion, *_ in seen] == [clips[0] for clips in found.runs for _ in (0, 1)]
    assert found.spread("error_abs_mm")[0] == np.mean([100 * k + seed for k, seed in expected])


def test_only_a_papers_experiments_are_read_twice():
    read = [("walk_straight", "literal"), ("walk_straight", "ours"), ("walk_best", "ours")]
    assert list(replicates._readings(["walk_straight", "walk_best"])) == read
