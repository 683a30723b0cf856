"""What every likelihood promises: (N,) log likelihoods, no NaN, clear errors, and warnings that are told once."""

import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.datasets.frame import Frame, View
from workbench.errors import InputError
from workbench.likelihoods.image_motion import ImageMotion
from workbench.likelihoods.likelihood import Likelihood
from workbench.likelihoods.uniform import Uniform

BODY = person(from_height(1.75))
LEFT = plain_camera(160, 120, 150.0, (3.0, -2.0, 1.0), (0.0, 0.0, 0.0), name="left")
RIGHT = plain_camera(160, 120, 150.0, (3.0, 2.0, 1.0), (0.0, 0.0, 0.0), name="right")
LIKELIHOODS: tuple[Likelihood, ...] = (
    Uniform(),
    ImageMotion(BODY),
    ImageMotion(BODY, occlusion="limb", exponent="sum"),
    ImageMotion(BODY, background="still"),
)


def frames(rng, *cameras):
    def views():
        return tuple(View(c, rng.integers(0, 256, (c.height, c.width)).astype(np.uint8)) for c in cameras)

    return Frame(0, 0.0, views()), Frame(1, 1 / 30, views())


def poses(rng, n):
    return 0.2 * rng.standard_normal((n, 25))


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda x: type(x).__name__)
def test_one_finite_number_per_particle(likelihood):
    rng = np.random.default_rng(0)
    for n in (0, 1, 33):
        found = likelihood.log_prob(*frames(rng, LEFT, RIGHT), poses(rng, n), poses(rng, n))
        assert found.shape == (n,)
        assert found.dtype == np.float64
        assert np.isfinite(found).all()


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda x: type(x).__name__)
def test_the_same_question_has_the_same_answer(likelihood):
    rng = np.random.default_rng(0)
    question = (*frames(rng, LEFT), poses(rng, 50), poses(rng, 50))
    copies = [np.copy(question[2]), np.copy(question[3])]
    np.testing.assert_array_equal(likelihood.log_prob(*question), likelihood.log_prob(*question))
    np.testing.assert_array_equal(question[2:], copies)  # and the question is left as it was


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda x: type(x).__name__)
def test_warnings_are_given_once(likelihood):
    rng = np.random.default_rng(0)
    far_aside = poses(rng, 5)
    far_aside[:, 1] -= 100.0  # behind the camera
    likelihood.warnings()
    likelihood.log_prob(*frames(rng, LEFT), far_aside, far_aside)
    assert bool(likelihood.warnings()) == isinstance(likelihood, ImageMotion)
    assert likelihood.warnings() == ()


def test_uniform_is_zero():
    rng = np.random.default_rng(0)
    assert not Uniform().log_prob(*frames(rng, LEFT), poses(rng, 4), poses(rng, 4)).any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_pose_that_is_not_finite_is_impossible_and_hurts_nobody_else(bad):
    rng = np.random.default_rng(0)
    likelihood, pair = ImageMotion(BODY), frames(rng, LEFT)
    previous, now = poses(rng, 40), poses(rng, 40)
    expected = likelihood.log_prob(*pair, previous, now)
    assert likelihood.warnings() == ()
    previous[3, 0], now[17, 24] = bad, bad
    expected[[3, 17]] = -np.inf
    np.testing.assert_array_equal(likelihood.log_prob(*pair, previous, now), expected)
    assert likelihood.warnings() == ("image motion: 2 of 40 poses were not finite",)


def test_absurd_but_finite_poses_do_not_crash():
    rng = np.random.default_rng(0)
    wild = np.concatenate([scale * rng.standard_normal((20, 25)) for scale in (1e3, 1e12, 1e150, 1e300)])
    found = ImageMotion(BODY).log_prob(*frames(rng, LEFT), wild, wild)
    assert not np.isnan(found).any()


@pytest.mark.parametrize(
    ("constant", "value"),
    [
        ("sigma", 0.0), ("sigma", float("nan")), ("epsilon", -0.1), ("epsilon", 1.0), ("p_occluded", 0.0),
        ("n_samples", 0), ("exponent", "max"), ("k", 0.0), ("occlusion", "yes"),
        ("background", "moving"), ("blur_px", -1.0),
    ],
)  # fmt: skip
def test_constants_out_of_range_are_named(constant, value):
    with pytest.raises(InputError, match=rf"image motion: {constant} must be .* found"):
        ImageMotion(BODY, **{constant: value})


def test_frames_without_a_common_camera():
    rng = np.random.default_rng(0)
    before, now = frames(rng, LEFT)[0], frames(rng, RIGHT)[1]
    with pytest.raises(InputError, match="frames 0 and 1 have no camera in common"):
        ImageMotion(BODY).log_prob(before, now, poses(rng, 2), poses(rng, 2))


def test_camera_missing_in_one_frame_is_told():
    rng = np.random.default_rng(0)
    likelihood, (before, now) = ImageMotion(BODY), frames(rng, LEFT, RIGHT)
    previous_pose, pose = poses(rng, 3), poses(rng, 3)
    only_left = Frame(0, 0.0, before.views[:1]), Frame(1, 1 / 30, now.views[:1])
    expected = likelihood.log_prob(*only_left, previous_pose, pose)
    assert likelihood.warnings() == ()
    np.testing.assert_array_equal(likelihood.log_prob(only_left[0], now, previous_pose, pose), expected)
    assert likelihood.warnings() == ("image motion: camera right is missing in frame 0 or 1",)


@pytest.mark.parametrize("shape", [(120, 161), (120, 160, 4), (120, 160, 1), (160, 120)])
def test_image_that_does_not_fit_its_camera(shape):
    rng = np.random.default_rng(0)
    frame = Frame(0, 0.0, (View(LEFT, np.zeros(shape, np.uint8)),))
    with pytest.raises(InputError, match="camera left: expected a grey or RGB image of 160×120 px"):
        ImageMotion(BODY).log_prob(frame, frame, poses(rng, 2), poses(rng, 2))
