"""Runs that are kept: none is made twice, and what they measure is what a run of the workbench does."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_module

from analysis.figures import kept_runs
from analysis.figures.kept_runs import every_run, measured, numbers_of, people, read_kept, spread
from workbench.experiment.schema import prepare_hydra

ROWS = {"one": ("walk_straight", ("prior=walking",)), "other": ("walk_circle", ())}


def test_a_table_goes_on_where_it_was_cut_off(tmp_path, monkeypatch):
    made = []

    def run_of(run, names):
        made.append(run)
        if len(made) == 3:
            raise KeyboardInterrupt
        return {"error_px": float(len(made))}

    monkeypatch.setattr(kept_runs, "measured", run_of)
    runs, out = every_run(ROWS, ["a", "b"], 2, ["dataset.n_frames=3"]), tmp_path / "kept" / "runs.jsonl"
    with pytest.raises(KeyboardInterrupt):
        numbers_of(runs, out, ["error_px"])
    found = numbers_of(runs, out, ["error_px"])
    assert len(made) == len(runs) + 1 == len(set(runs)) + 1  # the one that was cut off is made again
    assert list(found) == runs
    assert found == read_kept(out) == numbers_of(runs, out, ["error_px"])
    assert len(made) == len(runs) + 1


def test_every_person_is_run_with_every_row_before_the_next_seed():
    runs = every_run(ROWS, ["a", "b"], 2, ["dataset.n_frames=3"])
    assert [(run.row, run.clip, run.seed) for run in runs[:5]] == [
        ("one", "a", 0), ("other", "a", 0), ("one", "b", 0), ("other", "b", 0), ("one", "a", 1)
    ]  # fmt: skip
    assert runs[0].overrides == ("dataset.n_frames=3", "prior=walking")


def test_numbers_of_one_person_and_seed_have_no_spread():
    run = every_run(ROWS, ["a"], 1, ())[0]
    assert spread({run: {"z2": 1.25}}, "z2", ".1f") == "1.2"


def test_what_is_measured_is_a_run_and_what_it_has_not_is_unknown():
    prepare_hydra()
    small = ["dataset.n_frames=3", "inference.n_particles=20", "threads=1"]
    (run,) = every_run({"row": ("walk_prior_only", ())}, ["builtin"], 1, small)
    found = measured(run, ["coverage_90_legs", "knee_deg", "no_such_number"])
    assert 0.0 <= found["coverage_90_legs"] <= 1.0
    assert found["no_such_number"] != found["no_such_number"]


def test_people_are_those_of_the_lists():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        clips = compose("config").clips
    assert people("report", Path("data")) == list(clips.report)
    assert not set(people("choose", Path("data"))) & set(clips.report)
