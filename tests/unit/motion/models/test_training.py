"""Training sets and databases by name: what is in them, what is left out, and that a cached model is the same one."""

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
from workbench.utils.errors import InputError


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """Six walkers in one file; the second is called a run."""
    motions = [replace(motion, name=f"{k + 10}_0{k + 1}", subject=f"{k + 10}")
               for k, motion in enumerate(builtin_motions(6))]  # fmt: skip
    motions[1] = replace(motions[1], activity="run")
    path = tmp_path_factory.mktemp("library") / "six.h5"
    write_library(path, motions)
    return str(path)


def names(motions):
    return [motion.name for motion in motions]


@pytest.mark.parametrize(
    ("exclude", "missing"),
    [
        ((), set()),
        (("12_03",), {"12_03"}),
        (("1203",), {"12_03"}),  # how a command line reads 12_03
        (("some/where/12_03.amc",), {"12_03"}),
        (("six.h5:12_03",), {"12_03"}),
        (("12", "13_04"), {"12_03", "13_04"}),
        (("nobody",), set()),
    ],
)
def test_clips_and_subjects_are_left_out_by_any_of_their_names(library, tmp_path, exclude, missing):
    found = database_motions(library, data=None, cache=str(tmp_path), exclude=exclude)
    assert set(names(database_motions(library, data=None, cache=str(tmp_path)))) - set(names(found)) == missing


def test_walks_leave_out_clips_and_subjects_too(library, tmp_path):
    options = {"data": None, "cache": str(tmp_path), "subjects": None}
    found = training_motions(library, exclude=["12_03", "13"], **options)
    assert set(names(training_motions(library, **options))) - set(names(found)) == {"12_03", "13_04"}
    with pytest.raises(InputError, match=r"expected clips without 10, .* found 6 clips, of activity run, walk"):
        training_motions(library, exclude=[str(k) for k in range(10, 16)], **options)


def test_recorded_walks_are_those_of_cmu(monkeypatch, tmp_path):
    """Subjects that are left out are not even imported."""
    asked = []
    monkeypatch.setattr(training, "cmu_clips", lambda folder, subjects: asked.append(subjects) or [])
    monkeypatch.setattr(training, "_imported", lambda clips, cache, name: builtin_motions(2))
    for motions in ("cmu", "recorded"):
        options = {"data": str(tmp_path), "cache": str(tmp_path), "subjects": training.WALKERS}
        assert training_motions(motions, exclude=["32", "35"], **options)
    assert asked == [["02", "05", "06", "07", "08", "16", "39"]] * 2


def arrays(model):
    """All arrays of a model, by name, those of models within it too."""
    found = {}
    for field in fields(model):
        value = getattr(model, field.name)
        if is_dataclass(value):
            found |= {f"{field.name}.{name}": array for name, array in arrays(value).items()}
        elif isinstance(value, np.ndarray):
            found[field.name] = value
    return found


@pytest.mark.parametrize(
    "learn", [walking_model, partial(walking_model, include_root=True), cyclic_model, linear_motion, motion_windows]
)
def test_a_model_just_learned_is_laid_out_as_the_one_that_is_found(library, tmp_path, learn):
    """Sums over arrays that lie otherwise in memory round otherwise: the first run would not be the second one."""
    learned, read = (arrays(learn(motions=library, cache=str(tmp_path))) for _ in range(2))
    assert len(list((tmp_path / "models").glob("*.h5"))) == 1
    assert learned.keys() == read.keys()
    for name, array in learned.items():
        np.testing.assert_array_equal(array, read[name])
        assert (array.dtype, array.strides) == (read[name].dtype, read[name].strides), name


@pytest.mark.slow
def test_gaps_change_a_cyclic_model_a_little_and_its_file_altogether(tmp_path):
    whole = cyclic_model(cache=str(tmp_path), n_components=2)
    gappy = cyclic_model(cache=str(tmp_path), n_components=2, missing_fraction=0.2)
    assert len(list((tmp_path / "models").glob("cyclic-*.h5"))) == 2
    apart = np.abs(whole.mean[:, 1:] - gappy.mean[:, 1:]).max()
    # gaps of a fifth of 12 walkers × 5 cycles leave the mean cycle known to a degree or two
    assert 0.0 < apart < np.radians(2.0)
    again = cyclic_model(cache=str(tmp_path / "other"), n_components=2, missing_fraction=0.2)
    np.testing.assert_array_equal(gappy.mean, again.mean)


def test_generated_walks_and_runs_need_no_download(tmp_path):
    found = database_motions("builtin", data=None, cache=str(tmp_path))
    assert [motion.activity for motion in found] == ["walk"] * 12 + ["run"] * 12
    walks = training_motions("builtin", data=None, cache=str(tmp_path), subjects=None)
    assert {motion.activity for motion in walks} == {"walk"}
