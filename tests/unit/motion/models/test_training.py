"""Training motions by name, excluded clips and subjects, and cached models."""

from dataclasses import fields, is_dataclass, replace
from functools import partial

import numpy as np
import pytest

from workbench.motion.library import write_library
from workbench.motion.models import training
from workbench.motion.models.training import (
    cyclic_model,
    database_motions,
    linear_motion,
    motion_windows,
    training_motions,
    walking_model,
)
from workbench.motion.synthetic.gait import builtin_motions


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """Six walkers in one file; the second has the activity run."""
    motions = [replace(motion, name=f"{k + 10}_0{k + 1}", subject=f"{k + 10}")
               for k, motion in enumerate(builtin_motions(6))]  # fmt: skip
    motions[1] = replace(motions[1], activity="run")
    path = tmp_path_factory.mktemp("library") / "six.h5"
    write_library(path, motions)
    return str(path)


@pytest.mark.parametrize(
    ("exclude", "missing"),
    [
        ((), set()),
        (("12_03",), {"12_03"}),
        (("1203",), {"12_03"}),  # how a command line reads 12_03
        (("some/where/12_03.amc",), {"12_03"}),
        (("six.h5:12_03",), {"12_03"}),
        (("12", "13_04"), {"12_03", "13_04"}),
        (("unknown",), set()),
    ],
)
def test_clips_and_subjects_are_excluded_by_any_of_their_names(library, tmp_path, exclude, missing):
    motions = database_motions(library, data=None, cache=str(tmp_path), exclude=exclude)
    assert {f"{k + 10}_0{k + 1}" for k in range(6)} - {motion.name for motion in motions} == missing


def test_recorded_walks_are_those_of_cmu(monkeypatch, tmp_path):
    """Excluded subjects are not imported."""
    requested = []
    monkeypatch.setattr(training, "cmu_clips", lambda folder, subjects: requested.append(subjects) or [])
    monkeypatch.setattr(training, "_imported", lambda clips, cache, name: builtin_motions(2))
    for motions in ("cmu", "recorded"):
        options = {"data": str(tmp_path), "cache": str(tmp_path), "subjects": training.WALKERS}
        assert training_motions(motions, exclude=["32", "35"], **options)
    assert requested == [["02", "05", "06", "07", "08", "16", "39"]] * 2


def arrays(model):
    """Return the arrays of a model and of models within it, by name."""
    values = {}
    for field in fields(model):
        value = getattr(model, field.name)
        if is_dataclass(value):
            values |= {f"{field.name}.{name}": array for name, array in arrays(value).items()}
        elif isinstance(value, np.ndarray):
            values[field.name] = value
    return values


@pytest.mark.parametrize(
    "learn", [walking_model, partial(walking_model, include_root=True), cyclic_model, linear_motion, motion_windows]
)
def test_a_learned_model_equals_its_cached_copy_in_values_and_memory_layout(library, tmp_path, learn):
    """Sums over arrays of another memory layout round differently, so that two runs would differ."""
    learned, cached = (arrays(learn(motions=library, cache=str(tmp_path))) for _ in range(2))
    assert len(list((tmp_path / "models").glob("*.h5"))) == 1
    assert learned.keys() == cached.keys()
    for name, array in learned.items():
        np.testing.assert_array_equal(array, cached[name])
        assert (array.dtype, array.strides) == (cached[name].dtype, cached[name].strides), name


@pytest.mark.slow
def test_gaps_change_a_cyclic_model_slightly_and_have_their_own_file(library, tmp_path):
    complete = cyclic_model(motions=library, cache=str(tmp_path), n_components=2)
    gappy = cyclic_model(motions=library, cache=str(tmp_path), n_components=2, missing_fraction=0.2)
    assert len(list((tmp_path / "models").glob("cyclic-*.h5"))) == 2
    difference = np.abs(complete.mean[:, 1:] - gappy.mean[:, 1:]).max()
    # with a fifth of 6 walkers × 5 cycles missing, the mean cycle is known to two or three degrees
    assert 0.0 < difference < np.radians(2.0 * np.sqrt(2.0))
    second = cyclic_model(motions=library, cache=str(tmp_path / "other"), n_components=2, missing_fraction=0.2)
    np.testing.assert_array_equal(gappy.mean, second.mean)


def test_generated_walks_and_runs_need_no_download(tmp_path):
    motions = database_motions("builtin", data=None, cache=str(tmp_path))
    assert [motion.activity for motion in motions] == ["walk"] * 12 + ["run"] * 12
    walks = training_motions("builtin", data=None, cache=str(tmp_path), subjects=None)
    assert {motion.activity for motion in walks} == {"walk"}
