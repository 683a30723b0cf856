"""Statistics over seeds and people: means, intervals, power of tests, and the runs of a table."""

import numpy as np
import pytest
import yaml
from compositions import composed
from scipy import stats

from analysis.figures import cached_runs, pairs, replicates
from analysis.figures.recordings import Source
from analysis.figures.unrecorded import Result
from analysis.tables import __main__ as command
from analysis.tables import listed, table
from analysis.tables.listed import TABLES
from workbench.datasets.synthetic import Synthetic
from workbench.experiment.config.requirements import first_conflict

ROWS = {"one": ("walk_straight", ("prior=walking",)), "other": ("walk_circle", ())}


def replicates_of(*errors, tracked=()):
    runs = [{"mpjpe_abs_mm": error, "tracked": float(k in tracked)} for k, error in enumerate(errors)]
    return replicates.Replicates(tuple(runs))


def test_the_mean_over_seeds_has_the_normal_interval():
    assert replicates_of(30.0, 30.0, 30.0).mean("mpjpe_abs_mm") == (30.0, 30.0, 30.0)
    mean, low, high = replicates_of(*np.random.default_rng(0).normal(50.0, 10.0, 400)).mean("mpjpe_abs_mm")
    half = 1.96 * 10.0 / np.sqrt(400)  # for the mean of a normal distribution
    assert mean == pytest.approx(50.0, abs=2 * half)
    assert (mean - low, high - mean) == (pytest.approx(half, rel=0.1), pytest.approx(half, rel=0.1))
    assert replicates_of(10.0, 20.0, 90.0, tracked=(0, 1)).tracked_counts == (2, 3)


def rows_of(**errors_of_clips):
    """Return runs of clips with one error per seed."""
    return {
        cached_runs.Run("row", "walk_straight", clip, seed, ()): Result({"mpjpe_px": error, "tracked": 1.0}, {}, 1.0)
        for clip, errors in errors_of_clips.items()
        for seed, error in enumerate(errors)
    }


def test_means_over_people_give_every_person_the_same_weight():
    results = rows_of(**{"02_01": (10.0, 30.0), "02_04": (20.0, 20.0), "35_01": (50.0,)})
    assert table.of_people(results, "mpjpe_px") == [20.0, 50.0]
    assert table.mean("mpjpe_px").cell(results) == "35"
    assert table.between_people("mpjpe_px", 1).cell(results) == f"{15.0 * np.sqrt(2.0):.1f}"
    assert table.over_runs("mpjpe_px", np.median, 1).cell(results) == "20.0"
    assert (table.PEOPLE.cell(results), table.TRACKED.cell(results), table.RUNS.cell(results)) == ("2", "5", "5")
    single = rows_of(**{"02_01": (10.0, 30.0)})
    assert table.between_people("mpjpe_px").cell(single) == table.mean("mpjpe_abs_mm").cell(single) == table.NONE
    assert table.between_seeds("mpjpe_px", 1).cell(single) == f"{10.0 * np.sqrt(2.0):.1f}"
    assert [column.cell(single) for column in table.interval("mpjpe_px", 0)] == ["10", "30"]


def test_tables_replace_the_text_between_the_markers_of_a_page():
    page = "a\n<!-- table: one -->\nold\n<!-- end of table -->\nb\n<!-- table: two -->\nold\n<!-- end of table -->\n"
    filled = command.with_tables(page, {"one": "| new |\n"})
    assert filled == page.replace("old", "| new |", 1)
    assert command.with_tables(filled, {"one": "| new |\n"}) == filled


def test_the_computed_numbers_of_pairs_and_seeds_have_the_required_power():
    rng = np.random.default_rng(0)
    d = 1.0 + 2.0 * np.linspace(-1.0, 1.0, 9) / np.linspace(-1.0, 1.0, 9).std(ddof=1)
    n = pairs.pairs_needed(d, 0.01)
    p_values = stats.ttest_1samp(1.0 + 2.0 * rng.standard_normal((4000, n)), 0.0, axis=1).pvalue
    assert np.mean(p_values <= 0.01) == pytest.approx(0.95, abs=0.015)
    n = pairs.seeds_needed(39.0 + d, 1.0, 0.01)
    before, after = 2.0 * rng.standard_normal((2, 4000, n))
    assert np.mean(stats.ttest_ind(before, 1.0 + after, axis=1).pvalue <= 0.01) == pytest.approx(0.95, abs=0.015)


@pytest.mark.slow
def test_a_table_resumes_after_an_interruption(tmp_path, monkeypatch):
    runs_made = []

    def run_of(config, experiment):
        runs_made.append((experiment, config.dataset.motion, config.seed))
        if len(runs_made) == 3:
            raise KeyboardInterrupt
        return Result({"mpjpe_px": float(len(runs_made))}, {"mpjpe_px": [1.0, 2.0]}, 60.0)

    monkeypatch.setattr(cached_runs, "measured", run_of)
    runs = cached_runs.every_run(ROWS, ["builtin", "35_02"], 2, ["dataset.n_frames=3"])
    with pytest.raises(KeyboardInterrupt):
        cached_runs.numbers_of(runs, tmp_path, ["mpjpe_px"])
    numbers = cached_runs.numbers_of(runs, tmp_path, ["mpjpe_px", "tracked"])
    assert len(runs_made) == len(runs) + 1 == len(set(runs_made)) + 1  # the interrupted run is repeated
    assert list(numbers) == runs
    assert [row["mpjpe_px"] for row in numbers.values()] == [1.0, 2.0, *map(float, range(4, len(runs) + 2))]
    assert np.isnan(numbers[runs[0]]["tracked"])
    cache = cached_runs.RunCache(tmp_path)
    cache.expect(runs)
    assert (cache.n_missing, len(runs_made)) == (0, len(runs) + 1)
    assert cache.cached(runs[0]).series == {"mpjpe_px": [1.0, 2.0]}
    cache.expect([*runs, cached_runs.Run("more", "walk_circle", "builtin", 5, runs[1].overrides)])
    assert cache.n_missing == 1


def test_every_seed_has_its_own_scene_and_is_run_once(monkeypatch, tmp_path):
    calls = []

    def run(config, experiment):
        calls.append((config.paper, config.seed, config.dataset.seed))
        return Result({"tracked": 1.0, "mpjpe_abs_mm": float(config.seed)}, {}, 1.0)

    monkeypatch.setattr(cached_runs, "measured", run)
    source = Source(tmp_path, None, quick=True)
    for paper in replicates.PAPERS:
        assert replicates.replicates("walk_straight", paper, source).tracked_counts == (2, 2)
    assert calls == [(paper, seed, seed) for paper in ("literal", "ours") for seed in (0, 1)]
    replicates.replicates("walk_straight", "ours", source, n_seeds=3)
    assert calls[4:] == [("ours", 2, 2)]


@pytest.mark.slow
def test_every_row_of_a_table_has_a_valid_configuration():
    for labels, (experiment, overrides) in (listed.CALIBRATED | listed.PERTURBATIONS).items():
        config = composed(f"experiment={experiment}", "dataset.motion='02_01'", *overrides)
        assert first_conflict(config, {}) is None
        assert "02" in config.training.exclude
        assert labels[-1] != "no" or not config.dataset.perturb
    for _, overrides in listed.PERTURBATIONS.values():
        for key, value in (override.split("=", 1) for override in overrides):
            if key == "dataset.perturbations":
                Synthetic(perturb=False, perturbations=yaml.safe_load(value))  # rejects unknown perturbations
    likelihoods = {
        (labels[0], str(composed(f"experiment={experiment}", "dataset.motion='35_02'", *overrides).likelihood))
        for labels, (experiment, overrides) in listed.TUNED.items()
    }
    assert len(likelihoods) == len(listed.TUNED)
    for experiment, overrides in listed.HELD_OUT.values():
        assert first_conflict(composed(f"experiment={experiment}", "dataset.motion='02_01'", *overrides), {}) is None


def test_the_command_makes_every_table_of_the_pages():
    assert command.included() <= {*TABLES, *command.MEASURED, "claims", "recording_sizes"}
    assert {path.stem for path in command.FOLDER.glob("*.md")} == command.included()
    readme = command.README.read_text(encoding="utf-8")
    texts = {path.stem: path.read_text(encoding="utf-8") for path in command.FOLDER.glob("*.md")}
    assert command.with_tables(readme, texts) == readme
