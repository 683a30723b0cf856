"""What every likelihood promises: (N,) log likelihoods, no NaN, clear errors, and warnings that are told once."""

import numba
import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.datasets.frame import Frame, View
from workbench.errors import InputError
from workbench.likelihoods.appearance import Appearance
from workbench.likelihoods.background import Background
from workbench.likelihoods.edge_model import BINS, EdgeModel
from workbench.likelihoods.edges import Edges
from workbench.likelihoods.image_motion import ImageMotion
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.likelihood import Likelihood, remember
from workbench.likelihoods.product import Product
from workbench.likelihoods.silhouette import Silhouette
from workbench.likelihoods.uniform import Uniform

BODY = person(from_height(1.75))
LEFT = plain_camera(160, 120, 150.0, (3.0, -2.0, 1.0), (0.0, 0.0, 0.0), name="left")
RIGHT = plain_camera(160, 120, 150.0, (3.0, 2.0, 1.0), (0.0, 0.0, 0.0), name="right")


class Empty:
    """A clip of two cameras that see grey walls."""

    def __len__(self):
        return 3

    def frames(self):
        for i in range(3):
            yield Frame(i, i / 30, tuple(View(c, np.full((c.height, c.width), 128, np.uint8)) for c in (LEFT, RIGHT)))


def edges():
    likelihood, rng = Edges(BODY), np.random.default_rng(0)
    counts = rng.integers(1, 100, (2, 2, 7, BINS)).astype(float)
    parts = ("torso", "head", "upper_arm", "forearm", "hand", "thigh", "calf")
    likelihood.__dict__["model"] = EdgeModel(parts, counts[0], counts[1])  # instead of that of rendered people
    return likelihood


LIKELIHOODS: tuple[Likelihood, ...] = (
    Uniform(),
    ImageMotion(BODY),
    ImageMotion(BODY, occlusion="limb", exponent="sum"),
    ImageMotion(BODY, background="still"),
    Background(BODY, Empty()),
    Appearance(BODY),
    edges(),
    Silhouette(BODY, Empty()),
    KeypointLikelihood(BODY),
    Product({"motion": ImageMotion(BODY), "background": Background(BODY, Empty())}, {"motion": 0.5, "background": 1.0}),
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
        before, now = frames(rng, LEFT, RIGHT)
        remember(likelihood, before, np.zeros(25), first=True)
        found = likelihood.log_prob(before, now, poses(rng, n), poses(rng, n))
        assert found.shape == (n,)
        assert found.dtype == np.float64
        assert np.isfinite(found).all()


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda x: type(x).__name__)
def test_the_same_question_has_the_same_answer(likelihood):
    rng = np.random.default_rng(0)
    question = (*frames(rng, LEFT), poses(rng, 50), poses(rng, 50))
    copies = [np.copy(question[2]), np.copy(question[3])]
    remember(likelihood, question[0], np.zeros(25), first=True)
    np.testing.assert_array_equal(likelihood.log_prob(*question), likelihood.log_prob(*question))
    np.testing.assert_array_equal(question[2:], copies)  # and the question is left as it was


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda x: type(x).__name__)
def test_warnings_are_given_once(likelihood):
    rng = np.random.default_rng(0)
    far_aside = poses(rng, 5)
    far_aside[:, 1] -= 100.0  # behind the camera
    before, now = frames(rng, LEFT)
    remember(likelihood, before, np.zeros(25), first=True)
    likelihood.warnings()
    likelihood.log_prob(before, now, far_aside, far_aside)
    assert bool(likelihood.warnings()) == isinstance(
        likelihood, ImageMotion | Product | KeypointLikelihood
    )  # there are none
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


@pytest.mark.parametrize("likelihood", LIKELIHOODS[4:7], ids=lambda x: type(x).__name__)
def test_a_pose_that_is_not_finite_is_told_by_cues_of_single_frames(likelihood):
    rng = np.random.default_rng(0)
    before, now = frames(rng, LEFT)
    remember(likelihood, before, np.zeros(25), first=True)
    pose = poses(rng, 6)
    expected = likelihood.log_prob(before, now, pose, pose)
    likelihood.warnings()
    spoilt = pose.copy()
    spoilt[2, 7] = np.nan
    expected[2] = -np.inf
    np.testing.assert_array_equal(likelihood.log_prob(before, now, pose, spoilt), expected)
    assert any("1 of 6 poses were not finite" in sentence for sentence in likelihood.warnings())


@pytest.mark.parametrize("likelihood", LIKELIHOODS[4:8], ids=lambda x: type(x).__name__)
def test_one_and_two_threads_give_the_same_bits(likelihood):
    most = numba.config.NUMBA_NUM_THREADS
    if most < 2:
        pytest.skip("numba has one thread only here")
    rng = np.random.default_rng(0)
    question = (*frames(rng, LEFT, RIGHT), poses(rng, 200), poses(rng, 200))
    remember(likelihood, question[0], np.zeros(25), first=True)
    usual, found = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            found.append(likelihood.log_prob(*question))
    finally:
        numba.set_num_threads(usual)
    np.testing.assert_array_equal(*found)


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


def test_a_still_background_needs_images_of_one_size():
    rng = np.random.default_rng(0)
    (before, _), (_, now) = frames(rng, LEFT), frames(rng, LEFT.scaled(2.0))
    with pytest.raises(InputError, match="background=still needs images of one size from camera left"):
        ImageMotion(BODY, background="still").log_prob(before, now, poses(rng, 2), poses(rng, 2))
    assert np.isfinite(ImageMotion(BODY).log_prob(before, now, poses(rng, 2), poses(rng, 2))).all()


@pytest.mark.parametrize("shape", [(120, 161), (120, 160, 4), (120, 160, 1), (160, 120)])
def test_image_that_does_not_fit_its_camera(shape):
    rng = np.random.default_rng(0)
    frame = Frame(0, 0.0, (View(LEFT, np.zeros(shape, np.uint8)),))
    with pytest.raises(InputError, match="camera left: expected a grey or RGB image of 160×120 px"):
        ImageMotion(BODY).log_prob(frame, frame, poses(rng, 2), poses(rng, 2))
