"""The table of ankle angles: the true angle of a recording's foot, and the observations of a walk."""

from types import SimpleNamespace

import numpy as np
from feet_scenes import walker

from analysis.tables.ankles import _Walk, ankle_angles, observed


def test_the_angle_grows_as_the_toes_are_lifted():
    names = ("ltibia", "lfoot", "ltoes", "rtibia", "rfoot", "rtoes")
    lift = np.radians([0.0, 10.0, -25.0])
    toes = np.stack([np.cos(lift), np.zeros(3), np.sin(lift)], axis=1)
    side = np.stack([np.tile([0.0, 0.0, 2.0], (3, 1)), np.zeros((3, 3)), toes], axis=1)
    clip = SimpleNamespace(positions=np.concatenate([side, side[::-1]], axis=1), joint=names.index)
    left, right = ankle_angles(clip)
    np.testing.assert_allclose(left, 0.5 * np.pi + lift)
    np.testing.assert_allclose(right, left[::-1])


def test_a_walk_is_observed_with_its_feet():
    _, body, poses = walker(6)
    frames = observed(_Walk(body.shape, poses), -90.0, np.random.default_rng(0))
    assert len(frames) == 6
    (view,) = frames[0].views
    assert view.keypoints.shape == (15, 3)
    toes, heels = view.feet[[1, 3]], view.feet[[0, 2]]
    assert (toes[:, 0] > heels[:, 0]).all()  # the walk is along x, to the right in the image
