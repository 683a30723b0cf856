"""Invariances of the image-motion likelihood."""

from dataclasses import replace

import likelihood_scenes as scenes
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.likelihoods.image_motion import ImageMotion

BODY = person(from_height(1.7))
CAMERAS = tuple(
    plain_camera(200, 150, 190.0, (4.0 * np.cos(a), 4.0 * np.sin(a), 0.8), (0.0, 0.0, 0.0), name=f"camera {a}")
    for a in (0.2, 1.9)
)


def scene(seed, n=40):
    rng = np.random.default_rng(seed)
    frames = [Frame(i, i / 30, tuple(View(c, scenes.texture(rng, 200, 150)) for c in CAMERAS)) for i in range(2)]
    sigma = np.concatenate([np.full(3, 0.05), [0.5, 0.1, 0.1], np.full(19, 0.3)])
    previous, pose = (sigma * rng.standard_normal((n, 25)) for _ in range(2))
    return frames[0], frames[1], previous, pose


def with_views(frame, views):
    return replace(frame, views=tuple(views))


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_log_likelihoods_of_views_are_added(seed):
    before, now, previous, pose = scene(seed)
    likelihood = ImageMotion(BODY)
    separate = [
        scenes.log_prob(likelihood, with_views(before, [a]), with_views(now, [b]), previous, pose)
        for a, b in zip(before.views, now.views, strict=True)
    ]
    joint = scenes.log_prob(likelihood, before, with_views(now, now.views[::-1]), previous, pose)  # in any order
    np.testing.assert_allclose(joint, separate[0] + separate[1], rtol=1e-14)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_an_image_of_three_equal_channels_is_its_grey_image(seed):
    before, now, previous, pose = scene(seed)

    def coloured(frame):
        return with_views(frame, [View(v.camera, np.repeat(v.image[..., None], 3, axis=2)) for v in frame.views])

    likelihood = ImageMotion(BODY)
    grey = scenes.log_prob(likelihood, before, now, previous, pose)
    colour = scenes.log_prob(likelihood, coloured(before), coloured(now), previous, pose)
    np.testing.assert_allclose(colour, grey, rtol=0.0, atol=24 * 5 * 1e-4 / likelihood.sigma)
