"""The appearance likelihood against closed forms: templates of uniform limbs, robust updates, and new sides."""

import likelihood_scenes as scenes
import numpy as np
import pytest
import scipy

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


def expected_ratio(difference, n=1.0):
    variance = SIGMA**2 * (1.0 + 1.0 / n)
    normal = np.exp(-0.5 * np.square(difference) / variance) / np.sqrt(2.0 * np.pi * variance)
    return np.log(EPSILON + (1.0 - EPSILON) * 256.0 * normal)


def flat_frame(level, index=0):
    return scenes.frame(index, (scenes.FRONT, scenes.flat(level)))


@pytest.mark.parametrize("difference", [0, 10, 100])
def test_the_log_ratio_of_a_uniform_limb_is_the_closed_form(difference):
    likelihood = scenes.after_first_frame(
        Appearance(ROD, effective_pixels=2.0, sigma=SIGMA, outlier_fraction=EPSILON), flat_frame(100), scenes.root()[0]
    )
    log_prob = scenes.log_prob(
        likelihood, flat_frame(100), flat_frame(100 + difference, 1), scenes.root(), scenes.root()
    )
    np.testing.assert_allclose(log_prob, 2.0 * expected_ratio(difference), rtol=1e-6)


def test_the_kernel_agrees_with_numpy():
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
    expected = np.where(known, expected_ratio(levels - template.mean[cell], np.maximum(template.n[cell], 1)), 0.0)
    ratios = template_log_ratio(image, points, samples, template, SIGMA, EPSILON)
    # errors of float32 grey levels are 1e-4, and 255 · 1e-4 / σ² in the logarithm for a residual of 255
    np.testing.assert_allclose(ratios, expected.sum(axis=-1) / 20, rtol=0.0, atol=2e-4)


def test_cells_are_ordered_by_azimuth():
    """The azimuths at v = −1, 0, 1 of a limb rotated by φ are φ − π, φ − π/2 and φ."""
    samples = np.array([[0.0, -1.0], [0.55, 0.0], [1.0, 1.0]])
    along, around = cell_indices(samples, np.array([[0.01, 0.01 + np.pi, 0.01 - 2.0 * np.pi]]))
    assert along.tolist() == [0, 5, ALONG - 1]
    assert around[0].tolist() == [[12, 18, 0], [0, 6, 12], [12, 18, 0]]


def test_an_unobserved_side_has_a_log_ratio_of_zero_until_it_is_observed():
    """A body that turns by 180° shows its other side."""
    front, back = scenes.root(), scenes.root(heading=np.pi)
    likelihood = scenes.after_first_frame(
        Appearance(ROD, sigma=SIGMA, outlier_fraction=EPSILON), flat_frame(100), front[0]
    )
    assert scenes.log_prob(likelihood, flat_frame(100), flat_frame(100, 1), back, back)[0] == 0.0
    likelihood = likelihood.prepare(flat_frame(100), flat_frame(200, 1)).update(back[0])
    both = np.concatenate([front, back])
    for level, first, second in ((100, 0.0, 100.0), (200, 100.0, 0.0)):
        log_prob = scenes.log_prob(likelihood, flat_frame(100), flat_frame(level, 2), both, both)
        np.testing.assert_allclose(log_prob, [expected_ratio(first), expected_ratio(second)], rtol=1e-6)


def test_the_template_is_a_mean_and_then_an_exponential_average():
    levels = [np.full((1, 1, 1), level) for level in (100.0, 104.0, 96.0, 108.0)]
    template = None
    for level in levels[:3]:
        template = updated_template(template, level, 1e3, 1e-9, 0.25)  # no level is an outlier
    np.testing.assert_allclose(template.mean, 100.0, rtol=1e-6)
    np.testing.assert_allclose(template.n, 3.0, rtol=1e-6)
    for level in [*levels[3:], *levels[3:]]:
        before, template = template, updated_template(template, level, 1e3, 1e-9, 0.25)
        np.testing.assert_allclose(template.mean, before.mean + 0.25 * (108.0 - before.mean), rtol=1e-6)


def test_the_template_changes_by_the_probability_that_a_level_is_no_outlier():
    template = Template(np.full((1, 1, 1), 100.0), np.ones((1, 1, 1)))
    updated = updated_template(template, np.full((1, 1, 1), 110.0), 10.0, 0.3, 0.1)
    density = 0.7 * 256.0 * scipy.stats.norm.pdf(110.0, 100.0, np.sqrt(2.0) * 10.0)
    probability = density / (density + 0.3)
    assert updated.mean.item() == pytest.approx(100.0 + 0.5 * 10.0 * probability)
    assert updated.n.item() == pytest.approx(1.0 + probability)


def test_outliers_and_unobserved_cells_do_not_change_the_template():
    before = Template(np.array([100.0, 100.0, 0.0]), np.array([5.0, 5.0, 0.0]))
    updated = updated_template(before, np.array([220.0, np.nan, np.nan]), SIGMA, EPSILON, 0.1)
    np.testing.assert_allclose(updated.mean, before.mean, atol=1e-6)
    np.testing.assert_allclose(updated.n, before.n, atol=1e-6)


def test_an_occluded_limb_does_not_change_the_template():
    """A rod is 50 cm behind a wider one."""
    body = scenes.rods(((-0.5, 0.0, -0.2), (-0.5, 0.0, 0.2), 0.05), ((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.3))
    n = scenes.after_first_frame(Appearance(body), flat_frame(100), scenes.root()[0]).state.by_camera["front"].n
    assert not n[0].any()
    assert n[1].any()


def test_the_maximum_is_at_the_displacement_of_the_texture():
    """The texture moves with the rod by 5 px, 1/15 m, in front of a static background."""
    image = scenes.texture(np.random.default_rng(5))
    shifted = image.copy()
    shifted[90:150, 150:180] = image[90:150, 145:175]
    first = scenes.frame(0, (scenes.FRONT, image))
    likelihood = scenes.after_first_frame(Appearance(ROD), first, scenes.root()[0])
    shifts = np.arange(-8, 9)
    poses = np.repeat(scenes.root(), len(shifts), axis=0)
    poses[:, 1] = shifts / 75.0
    log_prob = scenes.log_prob(likelihood, flat_frame(0), scenes.frame(1, (scenes.FRONT, shifted)), poses, poses)
    assert shifts[np.argmax(log_prob)] == 5


def test_a_pose_that_is_not_finite_changes_nothing_and_is_noted_once():
    initial = scenes.after_first_frame(Appearance(ROD), flat_frame(100), scenes.root()[0])
    assert initial.prepare(flat_frame(100), flat_frame(150, 1)).notes == ()
    updated = initial.prepare(flat_frame(100), flat_frame(150, 1)).update(np.full(25, np.nan))
    assert updated.state.by_camera == initial.state.by_camera
    frame_likelihood = updated.prepare(flat_frame(150, 1), flat_frame(150, 2))
    assert frame_likelihood.notes == ("appearance: frame 1 has no finite expected pose; the template is not updated",)
    assert frame_likelihood.update(scenes.root()[0]).prepare(flat_frame(150, 2), flat_frame(150, 3)).notes == ()
