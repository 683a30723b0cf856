"""Recordings that differ only in their seeds form one group."""

from types import SimpleNamespace

import pytest

from workbench.results.check.rerun import _groups_of_seeds


def runs(*settings):
    return [SimpleNamespace(settings=values, name=k) for k, values in enumerate(settings)]


def settings_of(seed, scene, n=5):
    return {"seed": seed, "dataset": {"seed": scene, "n_frames": n}, "prior": {"sigma": 1.0}}


@pytest.mark.parametrize(
    ("settings", "groups"),
    [
        ((settings_of(0, 0), settings_of(1, 1), settings_of(2, 2)), [[0, 1, 2]]),  # a scene per seed
        ((settings_of(0, 0), settings_of(1, 0), settings_of(2, 0)), [[0, 1, 2]]),  # one scene
        ((settings_of(0, 0), settings_of(1, 0), settings_of(2, 1), settings_of(3, 1)), [[0, 1], [2, 3]]),  # two scenes
        ((settings_of(0, 0), settings_of(1, 1, n=9)), [[0], [1]]),
        (({"seed": 0, "study": {"n": 3}, "dataset": None}, {"seed": 1, "study": {"n": 3}, "dataset": None}), [[0, 1]]),
    ],
)
def test_runs_of_a_group_differ_only_in_seeds(settings, groups):
    assert [[run.name for run in group] for group in _groups_of_seeds(runs(*settings))] == groups
