"""What every likelihood promises, each of `conf/likelihood`: (N,) log likelihoods, and nothing that mutates."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np
import pytest
from still_clips import of_frames

from workbench.body.camera import plain_camera
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.core.frame import Frame, View
from workbench.core.likelihood import Likelihood
from workbench.likelihoods.cues.appearance import Appearance
from workbench.likelihoods.cues.background import Background
from workbench.likelihoods.cues.edges import BINS, EdgeModel, Edges
from workbench.likelihoods.cues.silhouette import Silhouette
from workbench.likelihoods.dense.dense_alignment import DenseAlignment
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


def walls():
    """A clip of two cameras that see grey walls."""
    views = tuple(View(c, np.full((c.height, c.width), 128, np.uint8)) for c in (LEFT, RIGHT))
    return of_frames([Frame(i, i / 30, views) for i in range(3)])


def edges():
    likelihood, rng = Edges(BODY), np.random.default_rng(0)
    counts = rng.integers(1, 100, (2, 2, 7, BINS)).astype(float)
    parts = ("torso", "head", "upper_arm", "forearm", "hand", "thigh", "calf")
    model = EdgeModel(parts, counts[0], counts[1])  # instead of that of rendered people
    likelihood.__dict__["log_ratio"] = model.log_ratio(BODY.limbs.names)
    return likelihood


def product():
    terms = {"image_motion": ImageMotion(BODY), "appearance": Appearance(BODY), "silhouette": Silhouette(BODY, walls())}
    return Product(terms, {"image_motion": 0.5, "appearance": 1.0, "silhouette": 0.5})


BUILDERS: dict[str, Callable[[], Likelihood]] = {
    "uniform": Uniform,
    "image_motion": lambda: ImageMotion(BODY),
    "image_motion, limbs hide": lambda: ImageMotion(BODY, occlusion="limb", reduction="sum"),
    "image_motion, still": lambda: ImageMotion(BODY, background="static"),
    "background": lambda: Background(BODY, walls()),
    "appearance": lambda: Appearance(BODY),
    "edges": edges,
    "silhouette": lambda: Silhouette(BODY, walls()),
    "keypoints": lambda: KeypointLikelihood(BODY),
    "surface_points": lambda: SurfacePoints(BODY),
    "dense_alignment": lambda: DenseAlignment(BODY, walls()),
    "product": product,
}


@dataclass(frozen=True)
class Case:
    """A likelihood, three frames that show it all it can look at, and how it names itself in notes."""

    likelihood: Likelihood
    frames: tuple[Frame, Frame, Frame]
    name: str

    def begun(self) -> Likelihood:
        """After the first frame."""
        return self.likelihood.prepare(None, self.frames[0]).update(np.zeros(25))


REMEMBER_THE_PERSON = ("dense_alignment", "appearance", "silhouette", "product")


@pytest.fixture(params=BUILDERS)
def case(request):
    name = request.param.split(",")[0].replace("_", " ")
    return Case(BUILDERS[request.param](), frames(np.random.default_rng(0), LEFT, RIGHT, n=3), name)


def frames(rng, *cameras, n=2):
    """Frames of noise, in which joints and points lie about the pose of zeros."""
    return tuple(Frame(i, i / 30, tuple(_view(rng, c) for c in cameras), points=_points(rng)) for i in range(n))


def _view(rng, camera):
    pixels = camera.project(joints(BODY.skeleton, np.zeros((1, 25)))[0])
    marks = np.column_stack([pixels + rng.standard_normal(pixels.shape), rng.uniform(0.1, 1.0, len(pixels))])
    return View(camera, rng.integers(0, 256, (camera.height, camera.width)).astype(np.uint8), marks)


def _points(rng):
    return rng.choice(joints(BODY.skeleton, np.zeros((1, 25)))[0], 70) + 0.08 * rng.standard_normal((70, 3))


def poses(n, seed=1):
    return 0.2 * np.random.default_rng(seed).standard_normal((n, 25))


def test_every_option_is_covered():
    assert {name.split(",")[0] for name in BUILDERS} == {path.stem for path in CONF.glob("*.yaml")}


@pytest.mark.parametrize("n", [0, 1, 33])
def test_one_finite_number_per_particle(case, n):
    found = case.begun().prepare(*case.frames[:2]).evaluate(poses(n), poses(n, 2)).log_prob
    assert found.shape == (n,)
    assert found.dtype == np.float64
    assert np.isfinite(found).all()
    assert n < 2 or np.ptp(found) > 0.0 or case.name == "uniform"


def test_a_particle_does_not_see_the_others(case):
    frame_likelihood, order = case.begun().prepare(*case.frames[:2]), np.random.default_rng(3).permutation(50)[:31]
    previous, pose = poses(50), poses(50, 2)
    everyone, some = frame_likelihood.evaluate(previous, pose), frame_likelihood.evaluate(previous[order], pose[order])
    np.testing.assert_array_equal(some.log_prob, everyone.log_prob[order])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_pose_that_is_not_finite_is_impossible_is_told_and_hurts_nobody_else(case, bad):
    frame_likelihood, previous, pose = case.begun().prepare(*case.frames[:2]), poses(40), poses(40, 2)
    whole = frame_likelihood.evaluate(previous, pose)
    assert not any("not finite" in note for note in (*frame_likelihood.notes, *whole.notes))
    spoilt = pose.copy()
    spoilt[17, 24] = bad
    found = frame_likelihood.evaluate(previous, spoilt)
    expected = whole.log_prob.copy()
    expected[17] = -np.inf
    np.testing.assert_array_equal(found.log_prob, expected)
    named = "image motion" if case.name == "product" else case.name
    assert f"{named}: 1 of 40 poses were not finite" in found.notes
    assert not any(
        "not finite" in note for note in (*frame_likelihood.notes, *frame_likelihood.evaluate(previous, pose).notes)
    )  # told once


def test_the_same_question_has_the_same_answer(case):
    likelihood, previous, pose = case.begun(), poses(50), poses(50, 2)
    asked = previous.copy(), pose.copy()
    frame_likelihood = likelihood.prepare(*case.frames[:2])
    first = frame_likelihood.evaluate(previous, pose)
    for again in (frame_likelihood, likelihood.prepare(*case.frames[:2])):
        found = again.evaluate(previous, pose)
        np.testing.assert_array_equal(found.log_prob, first.log_prob)
        assert (found.notes, found.diagnostics) == (first.notes, first.diagnostics)
        assert (again.notes, again.diagnostics) == (frame_likelihood.notes, frame_likelihood.diagnostics)
    np.testing.assert_array_equal([previous, pose], asked)  # and the question is left as it was


def test_what_is_remembered_changes_the_next_likelihood_alone(case):
    """A run that goes on leaves no trace: neither in the likelihood as it was built, nor in the looks taken."""
    begun, previous, pose = case.begun(), poses(20), poses(20, 2)
    frame_likelihood, built = begun.prepare(*case.frames[:2]), case.likelihood.prepare(*case.frames[:2])
    before, anew = frame_likelihood.evaluate(previous, pose), built.evaluate(previous, pose)
    for expected in (pose[0], np.full(25, np.nan), pose[1]):
        going_on = frame_likelihood.update(expected).prepare(*case.frames[1:]).update(expected)
        assert going_on.prepare(*case.frames[:2]).evaluate(previous, pose).log_prob.shape == (20,)
    for again, kept in ((frame_likelihood, before), (begun.prepare(*case.frames[:2]), before)):
        np.testing.assert_array_equal(again.evaluate(previous, pose).log_prob, kept.log_prob)
    found = case.likelihood.prepare(*case.frames[:2])
    np.testing.assert_array_equal(found.evaluate(previous, pose).log_prob, anew.log_prob)
    assert found.notes == built.notes


@pytest.mark.parametrize("case", sorted(set(BUILDERS) - set(REMEMBER_THE_PERSON)), indirect=True)
def test_frames_may_be_looked_at_out_of_order(case):
    """What is kept of the frame just seen is used for that very frame: an earlier pair has its own images."""
    later = case.begun().prepare(*case.frames[:2]).update(np.zeros(25)).prepare(*case.frames[1:]).update(np.zeros(25))
    for pair in (case.frames[:2], case.frames[1:], (case.frames[2], case.frames[0])):
        expected = case.likelihood.prepare(*pair).evaluate(poses(20), poses(20, 2))
        np.testing.assert_array_equal(
            later.prepare(*pair).evaluate(poses(20), poses(20, 2)).log_prob, expected.log_prob
        )


def test_diagnostics_have_the_same_names_from_the_first_look_on(case):
    first = case.likelihood.prepare(None, case.frames[0])
    frame_likelihood = first.update(np.zeros(25)).prepare(*case.frames[:2])
    for names in (frame_likelihood.diagnostics, frame_likelihood.evaluate(poses(5), poses(5, 2)).diagnostics):
        assert list(names) == list(first.diagnostics)
    assert all(value == 0.0 for value in first.diagnostics.values())
    assert first.notes == ()  # nothing is judged yet, so that nothing is lacking


def test_one_and_two_threads_give_the_same_bits(case):
    most = numba.config.NUMBA_NUM_THREADS
    if most < 2:
        pytest.skip("numba has one thread only here")
    frame_likelihood = case.begun().prepare(*case.frames[:2])
    usual, found = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            found.append(frame_likelihood.evaluate(poses(200), poses(200, 2)).log_prob)
    finally:
        numba.set_num_threads(usual)
    np.testing.assert_array_equal(*found)


def test_poses_far_beyond_the_image_are_judged_too(case):
    far_aside = poses(5)
    far_aside[:, 1] -= 100.0  # behind the camera
    found = case.begun().prepare(*case.frames[:2]).evaluate(far_aside, far_aside)
    assert not np.isnan(found.log_prob).any()
    outside = [note for note in found.notes if "lay outside the images of left" in note]
    assert len(outside) == (case.name in ("image motion", "product"))


def test_absurd_but_finite_poses_do_not_crash(case):
    rng = np.random.default_rng(0)
    wild = np.concatenate([scale * rng.standard_normal((20, 25)) for scale in (1e3, 1e12, 1e150, 1e300)])
    found = case.begun().prepare(*case.frames[:2]).evaluate(wild, wild).log_prob
    assert not np.isnan(found).any()


def test_uniform_is_zero():
    assert not Uniform().prepare(*frames(np.random.default_rng(0), LEFT)).evaluate(poses(4), poses(4)).log_prob.any()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_previous_pose_that_is_not_finite_matters_to_image_motion(bad):
    frame_likelihood, previous, pose = (
        ImageMotion(BODY).prepare(*frames(np.random.default_rng(0), LEFT)),
        poses(40),
        poses(40, 2),
    )
    expected = frame_likelihood.evaluate(previous, pose).log_prob
    previous[3, 0], pose[17, 24], expected[[3, 17]] = bad, bad, -np.inf
    found = frame_likelihood.evaluate(previous, pose)
    np.testing.assert_array_equal(found.log_prob, expected)
    assert found.notes == ("image motion: 2 of 40 poses were not finite",)


def test_camera_missing_in_one_frame_is_told():
    likelihood, (before, now) = ImageMotion(BODY), frames(np.random.default_rng(0), LEFT, RIGHT)
    only_left = Frame(0, 0.0, before.views[:1]), Frame(1, 1 / 30, now.views[:1])
    expected, frame_likelihood = likelihood.prepare(*only_left), likelihood.prepare(only_left[0], now)
    assert expected.notes == ()
    assert frame_likelihood.notes == ("image motion: camera right is missing in frame 0 or 1",)
    found = [one.evaluate(poses(3), poses(3, 2)).log_prob for one in (frame_likelihood, expected)]
    np.testing.assert_array_equal(*found)


def test_images_of_two_sizes_are_compared_unless_the_background_is_still():
    rng = np.random.default_rng(0)
    (before, _), (_, now) = frames(rng, LEFT), frames(rng, LEFT.scaled(2.0))
    with pytest.raises(InputError, match="background=static needs images of one size from camera left"):
        ImageMotion(BODY, background="static").prepare(before, now)
    assert np.isfinite(ImageMotion(BODY).prepare(before, now).evaluate(poses(2), poses(2, 2)).log_prob).all()


@pytest.mark.parametrize("make", [Background, Silhouette, DenseAlignment])
def test_a_camera_that_the_clip_does_not_have_is_refused(make):
    frame = frames(np.random.default_rng(0), replace(LEFT, name="another"))[0]
    with pytest.raises(InputError, match="camera another is not in the sequence"):
        make(BODY, walls()).prepare(None, frame).update(np.zeros(25)).prepare(frame, frame)


@pytest.mark.parametrize("shape", [(120, 161), (120, 160, 4), (120, 160, 1), (160, 120), None])
def test_frames_that_do_not_fit_are_refused(shape):
    before, now = (frames(np.random.default_rng(0), camera)[0] for camera in (LEFT, RIGHT))
    said = "frames 0 and 0 have no camera in common"
    if shape:
        before = now = Frame(0, 0.0, (View(LEFT, np.zeros(shape, np.uint8)),))
        said = "camera left: expected a grey or RGB image of 160×120 px"
    with pytest.raises(InputError, match=said):
        ImageMotion(BODY).prepare(before, now)
