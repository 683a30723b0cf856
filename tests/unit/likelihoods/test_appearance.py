"""The appearance term where the answer is known: templates of flat limbs, robust updates, sides seen one by one."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from workbench.body.kinematics import forward
from workbench.likelihoods.cues.appearance import (
    ALONG,
    AROUND,
    Appearance,
    Template,
    cell_indices,
    template_log_ratio,
    updated_template,
)
from workbench.likelihoods.cues.image_levels import bilinear
from workbench.likelihoods.cues.limb_points import limb_points
from workbench.likelihoods.image_motion import regular_samples

ROD = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))
SIGMA, EPSILON = 12.0, 0.1


def ratio(difference, n=1.0):
    variance = SIGMA**2 * (1.0 + 1.0 / n)
    normal = np.exp(-0.5 * np.square(difference) / variance) / np.sqrt(2.0 * np.pi * variance)
    return np.log(EPSILON + (1.0 - EPSILON) * 256.0 * normal)


def view(level, index=0):
    return scenes.frame(index, (scenes.FRONT, scenes.flat(level)))


@pytest.mark.parametrize("difference", [0, 10, 100])
def test_a_flat_limb_that_changes_its_level(difference):
    likelihood = scenes.after_first_frame(
        Appearance(ROD, effective_pixels=2.0, sigma=SIGMA, outlier_fraction=EPSILON), view(100), scenes.root()[0]
    )
    found = scenes.log_prob(likelihood, view(100), view(100 + difference, 1), scenes.root(), scenes.root())
    np.testing.assert_allclose(found, 2.0 * ratio(difference), rtol=1e-6)


def test_kernel_agrees_with_plain_numpy():
    rng = np.random.default_rng(3)
    samples, limbs = regular_samples(20, rng), len(scenes.PERSON.limbs)
    template = Template(
        128.0 + 40.0 * rng.standard_normal((limbs, ALONG, AROUND)), rng.integers(0, 4, (limbs, ALONG, AROUND))
    )
    image = scenes.texture(rng).astype(np.float32)
    points = limb_points(scenes.PERSON, samples, scenes.FRONT, forward(scenes.PERSON.skeleton, scenes.people(rng, 50)))
    along, around = cell_indices(samples, points.azimuths)
    cell = np.arange(limbs)[:, None], along, around
    levels = bilinear(image, points.pixels.astype(float))
    known = points.valid & (template.n[cell] > 0)
    assert 0.3 < known.mean() < 0.9
    values = np.where(known, ratio(levels - template.mean[cell], np.maximum(template.n[cell], 1)), 0.0)
    found = template_log_ratio(image, points, samples, template, SIGMA, EPSILON)
    # float32 grey levels are good to 1e-4, which a residual of 255 makes 255 · 1e-4 / σ² in the logarithm
    np.testing.assert_allclose(found, values.sum(axis=-1) / 20, rtol=0.0, atol=2e-4)


def test_cells_go_around_the_limb():
    """At v = −1, 0, 1 of a limb turned by φ the azimuth is φ − π, φ − π/2 and φ."""
    samples = np.array([[0.0, -1.0], [0.55, 0.0], [1.0, 1.0]])
    along, around = cell_indices(samples, np.array([[0.01, 0.01 + np.pi, 0.01 - 2.0 * np.pi]]))
    assert along.tolist() == [0, 5, ALONG - 1]
    assert around[0].tolist() == [[12, 18, 0], [0, 6, 12], [12, 18, 0]]


def test_a_side_is_learned_when_it_is_seen():
    """A body that turns half around shows its other side: not known, so worth nothing, until it is learned, too."""
    front, back = scenes.root(), scenes.root(heading=np.pi)
    likelihood = scenes.after_first_frame(Appearance(ROD, sigma=SIGMA, outlier_fraction=EPSILON), view(100), front[0])
    assert scenes.log_prob(likelihood, view(100), view(100, 1), back, back)[0] == 0.0
    likelihood = likelihood.prepare(view(100), view(200, 1)).update(back[0])
    both = np.concatenate([front, back])
    for level, first, second in ((100, 0.0, 100.0), (200, 100.0, 0.0)):
        found = scenes.log_prob(likelihood, view(100), view(level, 2), both, both)
        np.testing.assert_allclose(found, [ratio(first), ratio(second)], rtol=1e-6)


def test_the_template_averages_then_forgets():
    seen = [np.full((1, 1, 1), level) for level in (100.0, 104.0, 96.0, 108.0)]
    template = None
    for level in seen[:3]:
        template = updated_template(template, level, 1e3, 1e-9, 0.25)  # so wide that every level is trusted
    np.testing.assert_allclose(template.mean, 100.0, rtol=1e-6)
    np.testing.assert_allclose(template.n, 3.0, rtol=1e-6)
    for level in [*seen[3:], *seen[3:]]:
        before, template = template, updated_template(template, level, 1e3, 1e-9, 0.25)
        np.testing.assert_allclose(template.mean, before.mean + 0.25 * (108.0 - before.mean), rtol=1e-6)


def test_an_outlier_hardly_changes_the_template_and_what_is_not_seen_not_at_all():
    before = Template(np.array([100.0, 100.0, 0.0]), np.array([5.0, 5.0, 0.0]))
    found = updated_template(before, np.array([220.0, np.nan, np.nan]), SIGMA, EPSILON, 0.1)
    np.testing.assert_allclose(found.mean, before.mean, atol=1e-6)
    np.testing.assert_allclose(found.n, before.n, atol=1e-6)


def test_a_hidden_limb_teaches_nothing():
    """A rod 50 cm behind a broader one."""
    body = scenes.rods(((-0.5, 0.0, -0.2), (-0.5, 0.0, 0.2), 0.05), ((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.3))
    n = scenes.after_first_frame(Appearance(body), view(100), scenes.root()[0]).state.by_camera["front"].n
    assert not n[0].any()
    assert n[1].any()


def test_the_texture_is_best_explained_where_it_went():
    """The rod carries its texture 5 px to the right, 1/15 m, before a background that stays."""
    image = scenes.texture(np.random.default_rng(5))
    now = image.copy()
    now[90:150, 150:180] = image[90:150, 145:175]
    first = scenes.frame(0, (scenes.FRONT, image))
    likelihood = scenes.after_first_frame(Appearance(ROD), first, scenes.root()[0])
    shifts = np.arange(-8, 9)
    poses = np.repeat(scenes.root(), len(shifts), axis=0)
    poses[:, 1] = shifts / 75.0
    found = scenes.log_prob(likelihood, view(0), scenes.frame(1, (scenes.FRONT, now)), poses, poses)
    assert shifts[np.argmax(found)] == 5


def test_a_pose_that_is_not_finite_teaches_nothing_and_the_next_frame_says_so_once():
    once = scenes.after_first_frame(Appearance(ROD), view(100), scenes.root()[0])
    assert once.prepare(view(100), view(150, 1)).notes == ()
    twice = once.prepare(view(100), view(150, 1)).update(np.full(25, np.nan))
    assert twice.state.by_camera == once.state.by_camera
    frame_likelihood = twice.prepare(view(150, 1), view(150, 2))
    assert frame_likelihood.notes == ("appearance: frame 1 has no finite expected pose; the template is not updated",)
    assert frame_likelihood.update(scenes.root()[0]).prepare(view(150, 2), view(150, 3)).notes == ()
