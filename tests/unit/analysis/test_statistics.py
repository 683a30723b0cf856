"""Numbers over seeds and people: means, intervals, power of tests, and which runs a table is made of."""

import numpy as np
import pytest
import yaml
from compositions import composed
from scipy import stats

from analysis.figures import cached_runs, held_out_calibration, pairs, people, replicates, sensitivity, weights
from analysis.figures.recordings import Source
from workbench.datasets.synthetic import Synthetic
from workbench.experiment.config.requirements import first_conflict

ROWS = {"one": ("walk_straight", ("prior=walking",)), "other": ("walk_circle", ())}


def of(*errors, held=()):
    runs = [{"mpjpe_abs_mm": error, "tracked": float(k in held)} for k, error in enumerate(errors)]
    return replicates.Replicates(tuple(runs))


def test_the_mean_over_seeds_and_its_interval():
    assert of(30.0, 30.0, 30.0).mean("mpjpe_abs_mm") == (30.0, 30.0, 30.0)
    mean, low, high = of(*np.random.default_rng(0).normal(50.0, 10.0, 400)).mean("mpjpe_abs_mm")
    half = 1.96 * 10.0 / np.sqrt(400)  # of the normal distribution's mean
    assert mean == pytest.approx(50.0, abs=2 * half)
    assert (mean - low, high - mean) == (pytest.approx(half, rel=0.1), pytest.approx(half, rel=0.1))
    assert of(10.0, 20.0, 90.0, held=(0, 1)).tracked_counts == (2, 3)


def test_means_over_people_weigh_every_person_alike():
    runs = {("a",): [{"mpjpe_abs_mm": 10.0, "tracked": 1.0}, {"mpjpe_abs_mm": 30.0, "tracked": 0.0}]}
    alone = people.OverPeople(runs)
    assert (alone.spread("mpjpe_abs_mm")[0], alone.tracked_counts) == (20.0, (1, 2))
    assert np.isnan(alone.spread("mpjpe_abs_mm")[1])
    both = people.OverPeople(runs | {("b",): [{"mpjpe_abs_mm": 50.0, "tracked": 1.0}]})
    assert both.spread("mpjpe_abs_mm") == (35.0, pytest.approx(15.0 * np.sqrt(2.0)))
    assert both.tracked_counts == (2, 3)


def test_as_many_pairs_and_seeds_as_computed_find_the_change():
    rng = np.random.default_rng(0)
    d = 1.0 + 2.0 * np.linspace(-1.0, 1.0, 9) / np.linspace(-1.0, 1.0, 9).std(ddof=1)
    n = pairs.pairs_needed(d, 0.01)
    drawn = stats.ttest_1samp(1.0 + 2.0 * rng.standard_normal((4000, n)), 0.0, axis=1).pvalue
    assert np.mean(drawn <= 0.01) == pytest.approx(0.95, abs=0.015)
    n = pairs.seeds_needed(39.0 + d, 1.0, 0.01)
    before, after = 2.0 * rng.standard_normal((2, 4000, n))
    assert np.mean(stats.ttest_ind(before, 1.0 + after, axis=1).pvalue <= 0.01) == pytest.approx(0.95, abs=0.015)


def test_a_table_continues_where_it_was_interrupted(tmp_path, monkeypatch):
    made = []

    def run_of(run, names):
        made.append(run)
        if len(made) == 3:
            raise KeyboardInterrupt
        return {"mpjpe_px": float(len(made))}

    monkeypatch.setattr(cached_runs, "measured", run_of)
    runs, out = cached_runs.every_run(ROWS, ["a", "b"], 2, ["dataset.n_frames=3"]), tmp_path / "kept" / "runs.jsonl"
    with pytest.raises(KeyboardInterrupt):
        cached_runs.numbers_of(runs, out, ["mpjpe_px"])
    numbers = cached_runs.numbers_of(runs, out, ["mpjpe_px"])
    assert len(made) == len(runs) + 1 == len(set(runs)) + 1  # the interrupted one is made again
    assert list(numbers) == runs
    assert numbers == cached_runs.read_cached(out)


def test_every_seed_has_a_scene_of_its_own_and_is_run_once(monkeypatch, tmp_path):
    seen = []

    def run(config, experiment):
        seen.append((config.paper, config.seed, config.dataset.seed))
        return {"tracked": 1.0, "mpjpe_abs_mm": float(config.seed)}

    monkeypatch.setattr(replicates, "_run", run)
    source = Source(tmp_path, None, quick=True)
    for paper in replicates.PAPERS:
        assert replicates.replicates("walk_straight", paper, source).tracked_counts == (2, 2)
    assert seen == [(paper, seed, seed) for paper in ("literal", "ours") for seed in (0, 1)]
    replicates.replicates("walk_straight", "ours", source, n_seeds=3)
    assert seen[4:] == [("ours", 2, 2)]


@pytest.mark.slow
def test_every_row_of_a_table_can_be_run():
    for row, (experiment, overrides) in held_out_calibration.ROWS.items():
        config = composed(f"experiment={experiment}", "dataset.motion='02_01'", *overrides)
        assert first_conflict(config, {}) is None
        assert "02" in config.training.exclude
        assert config.dataset.perturb == (not row.endswith("exact"))
    for overrides in sensitivity.ROWS.values():
        for key, value in (override.split("=", 1) for override in overrides):
            if key == "dataset.perturbations":
                Synthetic(perturb=False, perturbations=yaml.safe_load(value))  # refuses what it does not know
    for choice in weights.CHOICES.values():
        rows = weights.rows_of(choice)
        likelihoods = {
            str(composed(f"experiment={experiment}", "dataset.motion='35_02'", *overrides).likelihood)
            for experiment, overrides in rows.values()
        }
        assert len(likelihoods) == len(rows) > 2
