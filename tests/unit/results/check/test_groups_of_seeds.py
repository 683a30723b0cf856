"""Recordings of several seeds are compared together if they differ in nothing but seeds."""

from types import SimpleNamespace

import pytest

from workbench.results.check.rerun import _groups_of_seeds


def runs(*settings):
    return [SimpleNamespace(settings=each, name=k) for k, each in enumerate(settings)]


def of(seed, scene, n=5):
    return {"seed": seed, "dataset": {"seed": scene, "n_frames": n}, "prior": {"sigma": 1.0}}


@pytest.mark.parametrize(
    ("settings", "groups"),
    [
        ((of(0, 0), of(1, 1), of(2, 2)), [[0, 1, 2]]),  # each seed draws its scene
        ((of(0, 0), of(1, 0), of(2, 0)), [[0, 1, 2]]),  # one scene
        ((of(0, 0), of(1, 0), of(2, 1), of(3, 1)), [[0, 1], [2, 3]]),  # two scenes
        ((of(0, 0), of(1, 1, n=9)), [[0], [1]]),
        (({"seed": 0, "study": {"n": 3}, "dataset": None}, {"seed": 1, "study": {"n": 3}, "dataset": None}), [[0, 1]]),
    ],
)
def test_groups_are_those_that_differ_only_in_seeds(settings, groups):
    assert [[run.name for run in group] for group in _groups_of_seeds(runs(*settings))] == groups
