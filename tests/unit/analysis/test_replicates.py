"""An experiment's numbers over seeds: means and intervals of known values, and what is run again and what is not."""

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.figures import replicates
from analysis.figures.readings import Reading
from analysis.figures.recordings import Source
from workbench.errors import InputError


def of(*errors, held=()):
    runs = [{"error_abs_mm": error, "held": float(k in held)} for k, error in enumerate(errors)]
    return replicates.Replicates(tuple(runs))


def test_the_mean_and_its_interval():
    assert of(30.0, 30.0, 30.0).mean("error_abs_mm") == (30.0, 30.0, 30.0)
    mean, low, high = of(*np.random.default_rng(0).normal(50.0, 10.0, 400)).mean("error_abs_mm")
    half = 1.96 * 10.0 / np.sqrt(400)  # of the normal distribution's mean
    assert mean == pytest.approx(50.0, abs=2 * half)
    assert (mean - low, high - mean) == (pytest.approx(half, rel=0.1), pytest.approx(half, rel=0.1))


def test_how_many_hold_and_how_it_is_told():
    found = of(10.0, 20.0, 90.0, held=(0, 1))
    assert found.held == (2, 3)
    assert found.told("error_abs_mm", "mm").startswith("40 mm (")
    assert of(9.94).told("error_abs_mm", "mm") == "9.9 mm"  # one seed has no interval
    assert of(9.94).told("error_abs_mm", "° knees") == "9.9° knees"
    line = list(replicates.table({("walk_straight", "ours"): found}))[-1]
    assert line.startswith("| walk_straight | ours | 2 of 3 | 40 mm (")


def test_nothing_is_told_of_seeds_that_track_nobody():
    made = replicates.Replicates(({"held": 0.0, "same_activity": 1.0},) * 2)
    found = Reading({}, {"ours": made, "literal": of(10.0, 20.0, held=(0,))})
    assert (found.told("ours"), found.row("ours")) == ("", "Ours")
    assert found.told("literal").startswith("1 of 2 seeds hold; 15.0 mm (")


def test_every_seed_has_a_scene_of_its_own_and_is_run_once(monkeypatch, tmp_path):
    seen = []

    def run(config, experiment):
        seen.append((config.paper, config.seed, config.dataset.seed))
        return {"held": 1.0, "error_abs_mm": float(config.seed)}

    monkeypatch.setattr(replicates, "_run", run)
    source = Source(tmp_path, None, quick=True)
    found = {paper: replicates.replicates("walk_straight", paper, source) for paper in replicates.PAPERS}
    assert seen == [(paper, seed, 1000 + seed) for paper in ("literal", "ours") for seed in (0, 1)]
    assert found["ours"].held == (2, 2)
    replicates.replicates("walk_straight", "ours", source, n_seeds=3)
    assert seen[4:] == [("ours", 2, 1002)]
    kept = sorted(path.name.rpartition("-")[0] for path in Path(tmp_path, "replicates").iterdir())
    assert kept == ["walk_straight-literal", "walk_straight-ours"]
    assert all(json.loads(path.read_text()) for path in Path(tmp_path, "replicates").iterdir())


def test_what_cannot_be_run_is_refused_in_one_sentence(tmp_path):
    source = Source(tmp_path, None, quick=True)
    with pytest.raises(InputError, match="learn_walk: a study has no replicates"):
        replicates.replicates("learn_walk", "ours", source)
    with pytest.raises(InputError, match="walk_best is in none of the papers"):
        replicates.replicates("walk_best", "literal", source)


def test_a_run_without_images_holds_by_its_last_joints():
    """A person who is fitted to points, without a motion model, at a tiny size."""
    small = ["dataset.n_frames=3", "dataset.n_points=60", "inference.n_particles=10", "dataset.motion=builtin"]
    found = replicates._run(replicates.composed(["experiment=points_no_model", *small]), "points_no_model")
    assert found["held"] == float(found["error_abs_mm"] < replicates.HELD_MM)  # of the last two
