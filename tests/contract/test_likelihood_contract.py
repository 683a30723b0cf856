"""The contract of every likelihood in `conf/likelihood`: (N,) log likelihoods and no mutation of inputs or state."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np
import pytest
from still_clips import of_frames

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.core.likelihood import FrameLikelihood, Likelihood
from workbench.likelihoods.cues.appearance import Appearance
from workbench.likelihoods.cues.background import Background
from workbench.likelihoods.cues.edges import BINS, EdgeModel, Edges
from workbench.likelihoods.cues.silhouette import Silhouette
from workbench.likelihoods.image_motion import ImageMotion
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.likelihoods.uniform import Uniform
from workbench.utils.errors import InputError

BODY = person(from_height(1.75))
LEFT = plain_camera(160, 120, 150.0, (3.0, -2.0, 1.0), (0.0, 0.0, 0.0), name="left")
RIGHT = plain_camera(160, 120, 150.0, (3.0, 2.0, 1.0), (0.0, 0.0, 0.0), name="right")
CONF = Path(__file__).parents[2] / "conf" / "likelihood"


def clip():
    """Return a clip of two cameras that face grey walls."""
    views = tuple(View(c, np.full((c.height, c.width), 128, np.uint8)) for c in (LEFT, RIGHT))
    return of_frames([Frame(i, i / 30, views) for i in range(3)])


def edges():
    likelihood, rng = Edges(BODY), np.random.default_rng(0)
    counts = rng.integers(1, 100, (2, 2, 7, BINS)).astype(float)
    parts = ("torso", "head", "upper_arm", "forearm", "hand", "thigh", "calf")
    model = EdgeModel(parts, counts[0], counts[1])  # replaces the model of rendered people
    likelihood.__dict__["log_ratio"] = model.log_ratio(BODY.limbs.names)
    return likelihood


def product():
    terms = {"image_motion": ImageMotion(BODY), "appearance": Appearance(BODY), "silhouette": Silhouette(BODY, clip())}
    return Product(terms, {"image_motion": 0.5, "appearance": 1.0, "silhouette": 0.5})


BUILDERS: dict[str, Callable[[], Likelihood]] = {
    "uniform": Uniform,
    "image_motion": lambda: ImageMotion(BODY),
    "image_motion, limb occlusion": lambda: ImageMotion(BODY, occlusion="limb", reduction="sum"),
    "image_motion, static background": lambda: ImageMotion(BODY, background="static"),
    "background": lambda: Background(BODY, clip()),
    "appearance": lambda: Appearance(BODY),
    "edges": edges,
    "silhouette": lambda: Silhouette(BODY, clip()),
    "keypoints": lambda: KeypointLikelihood(BODY),
    "surface_points": lambda: SurfacePoints(BODY),
    "product": product,
}


@dataclass(frozen=True)
class Case:
    """A likelihood, three frames with every kind of observation, and the likelihood's name in notes."""

    likelihood: Likelihood
    frames: tuple[Frame, Frame, Frame]
    name: str

    def after_first_frame(self) -> Likelihood:
        return self.likelihood.prepare(None, self.frames[0]).update(np.zeros(25))

    def frame_likelihood(self) -> FrameLikelihood:
        return self.after_first_frame().prepare(*self.frames[:2])


WITH_APPEARANCE_MODEL = ("appearance", "silhouette", "product")


@pytest.fixture(params=BUILDERS)
def case(request):
    name = request.param.split(",")[0].replace("_", " ")
    return Case(BUILDERS[request.param](), frames(np.random.default_rng(0), LEFT, RIGHT, n=3), name)


def frames(rng, *cameras, n=2):
    """Return frames of noise whose joints and points lie near the zero pose."""
    return tuple(Frame(i, i / 30, tuple(_view(rng, c) for c in cameras), points=_points(rng)) for i in range(n))


def _view(rng, camera):
    pixels = camera.project(joints(BODY.skeleton, np.zeros((1, 25)))[0])
    keypoints = np.column_stack([pixels + rng.standard_normal(pixels.shape), rng.uniform(0.1, 1.0, len(pixels))])
    return View(camera, rng.integers(0, 256, (camera.height, camera.width)).astype(np.uint8), keypoints)


def _points(rng):
    return rng.choice(joints(BODY.skeleton, np.zeros((1, 25)))[0], 70) + 0.08 * rng.standard_normal((70, 3))


def poses(n, seed=1):
    return 0.2 * np.random.default_rng(seed).standard_normal((n, 25))


def test_every_option_is_covered():
    assert {name.split(",")[0] for name in BUILDERS} == {path.stem for path in CONF.glob("*.yaml")}


@pytest.mark.parametrize("n", [0, 1, 33])
def test_every_particle_has_one_finite_log_likelihood(case, n):
    frame_likelihood = case.frame_likelihood()
    log_prob = frame_likelihood.evaluate(poses(n), poses(n, 2)).log_prob
    assert log_prob.shape == (n,)
    assert log_prob.dtype == np.float64
    assert np.isfinite(log_prob).all()
    assert n < 2 or np.ptp(log_prob) > 0.0 or case.name == "uniform"


def test_a_log_likelihood_does_not_depend_on_the_other_particles(case):
    frame_likelihood, order = case.frame_likelihood(), np.random.default_rng(3).permutation(50)[:31]
    previous, pose = poses(50), poses(50, 2)
    expected = frame_likelihood.evaluate(previous, pose).log_prob[order]
    np.testing.assert_array_equal(frame_likelihood.evaluate(previous[order], pose[order]).log_prob, expected)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_pose_that_is_not_finite_has_probability_zero_and_is_noted_once(case, bad):
    frame_likelihood, previous, pose = case.frame_likelihood(), poses(40), poses(40, 2)
    finite = frame_likelihood.evaluate(previous, pose)
    assert not any("not finite" in note for note in (*frame_likelihood.notes, *finite.notes))
    spoiled = pose.copy()
    spoiled[17, 24] = bad
    evaluation = frame_likelihood.evaluate(previous, spoiled)
    expected = finite.log_prob.copy()
    expected[17] = -np.inf
    np.testing.assert_array_equal(evaluation.log_prob, expected)
    name = "image motion" if case.name == "product" else case.name
    assert f"{name}: 1 of 40 poses were not finite" in evaluation.notes
    assert not any(
        "not finite" in note for note in (*frame_likelihood.notes, *frame_likelihood.evaluate(previous, pose).notes)
    )


def test_equal_inputs_give_equal_outputs_and_stay_unchanged(case):
    likelihood, previous, pose = case.after_first_frame(), poses(50), poses(50, 2)
    inputs = previous.copy(), pose.copy()
    frame_likelihood = likelihood.prepare(*case.frames[:2])
    first = frame_likelihood.evaluate(previous, pose)
    for repeated in (frame_likelihood, likelihood.prepare(*case.frames[:2])):
        evaluation = repeated.evaluate(previous, pose)
        np.testing.assert_array_equal(evaluation.log_prob, first.log_prob)
        assert (evaluation.notes, evaluation.diagnostics) == (first.notes, first.diagnostics)
        assert (repeated.notes, repeated.diagnostics) == (frame_likelihood.notes, frame_likelihood.diagnostics)
    np.testing.assert_array_equal([previous, pose], inputs)


def test_an_update_changes_only_the_returned_likelihood(case):
    """Updates change neither the original likelihood nor frame likelihoods prepared earlier."""
    updated, previous, pose = case.after_first_frame(), poses(20), poses(20, 2)
    frame_likelihood, original = updated.prepare(*case.frames[:2]), case.likelihood.prepare(*case.frames[:2])
    expected, expected_original = (one.evaluate(previous, pose).log_prob for one in (frame_likelihood, original))
    for mean in (pose[0], np.full(25, np.nan), pose[1]):
        later = frame_likelihood.update(mean).prepare(*case.frames[1:]).update(mean)
        assert later.prepare(*case.frames[:2]).evaluate(previous, pose).log_prob.shape == (20,)
    for repeated in (frame_likelihood, updated.prepare(*case.frames[:2])):
        np.testing.assert_array_equal(repeated.evaluate(previous, pose).log_prob, expected)
    repeated = case.likelihood.prepare(*case.frames[:2])
    np.testing.assert_array_equal(repeated.evaluate(previous, pose).log_prob, expected_original)
    assert repeated.notes == original.notes


@pytest.mark.parametrize("case", sorted(set(BUILDERS) - set(WITH_APPEARANCE_MODEL)), indirect=True)
def test_frames_may_be_evaluated_out_of_order(case):
    """Cached images of the last frame are not used for another pair of frames."""
    later = case.frame_likelihood().update(np.zeros(25)).prepare(*case.frames[1:]).update(np.zeros(25))
    for pair in (case.frames[:2], case.frames[1:], (case.frames[2], case.frames[0])):
        expected = case.likelihood.prepare(*pair).evaluate(poses(20), poses(20, 2))
        np.testing.assert_array_equal(
            later.prepare(*pair).evaluate(poses(20), poses(20, 2)).log_prob, expected.log_prob
        )


def test_diagnostics_have_the_same_names_in_every_frame(case):
    first = case.likelihood.prepare(None, case.frames[0])
    frame_likelihood = first.update(np.zeros(25)).prepare(*case.frames[:2])
    for names in (frame_likelihood.diagnostics, frame_likelihood.evaluate(poses(5), poses(5, 2)).diagnostics):
        assert list(names) == list(first.diagnostics)
    assert all(value == 0.0 for value in first.diagnostics.values())
    assert first.notes == ()


def test_one_and_two_threads_give_bitwise_identical_results(case):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("numba has one thread only here")
    frame_likelihood = case.frame_likelihood()
    n_threads, results = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            results.append(frame_likelihood.evaluate(poses(200), poses(200, 2)).log_prob)
    finally:
        numba.set_num_threads(n_threads)
    np.testing.assert_array_equal(*results)


def test_poses_far_outside_the_image_have_a_log_likelihood(case):
    outside_poses = poses(5)
    outside_poses[:, 1] -= 100.0  # behind the camera
    evaluation = case.frame_likelihood().evaluate(outside_poses, outside_poses)
    assert not np.isnan(evaluation.log_prob).any()
    outside = [note for note in evaluation.notes if "lay outside the images of left" in note]
    assert len(outside) == (case.name in ("image motion", "product"))


def test_extreme_finite_poses_do_not_give_nan(case):
    rng = np.random.default_rng(0)
    extreme = np.concatenate([scale * rng.standard_normal((20, 25)) for scale in (1e3, 1e12, 1e150, 1e300)])
    evaluation = case.frame_likelihood().evaluate(extreme, extreme)
    assert not np.isnan(evaluation.log_prob).any()


def test_uniform_is_zero():
    assert not Uniform().prepare(*frames(np.random.default_rng(0), LEFT)).evaluate(poses(4), poses(4)).log_prob.any()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_image_motion_gives_a_non_finite_previous_pose_probability_zero(bad):
    frame_likelihood = ImageMotion(BODY).prepare(*frames(np.random.default_rng(0), LEFT))
    previous, pose = poses(40), poses(40, 2)
    expected = frame_likelihood.evaluate(previous, pose).log_prob
    previous[3, 0], pose[17, 24], expected[[3, 17]] = bad, bad, -np.inf
    evaluation = frame_likelihood.evaluate(previous, pose)
    np.testing.assert_array_equal(evaluation.log_prob, expected)
    assert evaluation.notes == ("image motion: 2 of 40 poses were not finite",)


def test_a_camera_missing_in_one_frame_is_noted():
    likelihood, (before, now) = ImageMotion(BODY), frames(np.random.default_rng(0), LEFT, RIGHT)
    only_left = Frame(0, 0.0, before.views[:1]), Frame(1, 1 / 30, now.views[:1])
    expected, frame_likelihood = likelihood.prepare(*only_left), likelihood.prepare(only_left[0], now)
    assert expected.notes == ()
    assert frame_likelihood.notes == ("image motion: camera right is missing in frame 0 or 1",)
    results = [each.evaluate(poses(3), poses(3, 2)).log_prob for each in (frame_likelihood, expected)]
    np.testing.assert_array_equal(*results)


def test_images_of_two_sizes_are_compared_unless_the_background_is_static():
    rng = np.random.default_rng(0)
    (before, _), (_, now) = frames(rng, LEFT), frames(rng, LEFT.scaled(2.0))
    with pytest.raises(InputError, match="background=static needs images of one size from camera left"):
        ImageMotion(BODY, background="static").prepare(before, now)
    assert np.isfinite(ImageMotion(BODY).prepare(before, now).evaluate(poses(2), poses(2, 2)).log_prob).all()


@pytest.mark.parametrize("make", [Background, Silhouette])
def test_a_camera_missing_in_the_clip_is_rejected(make):
    frame = frames(np.random.default_rng(0), replace(LEFT, name="another"))[0]
    with pytest.raises(InputError, match="camera another is not in the sequence"):
        make(BODY, clip()).prepare(None, frame).update(np.zeros(25)).prepare(frame, frame)


@pytest.mark.parametrize("shape", [(120, 161), (120, 160, 4), (120, 160, 1), (160, 120), None])
def test_frames_without_a_common_camera_or_with_wrong_images_are_rejected(shape):
    before, now = (frames(np.random.default_rng(0), camera)[0] for camera in (LEFT, RIGHT))
    message = "frames 0 and 0 have no camera in common"
    if shape:
        before = now = Frame(0, 0.0, (View(LEFT, np.zeros(shape, np.uint8)),))
        message = "camera left: expected a grey or RGB image of 160×120 px"
    with pytest.raises(InputError, match=message):
        ImageMotion(BODY).prepare(before, now)
