"""Faults of recordings, one function each: of a clip, what the same clip is with this fault."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from analysis.tables.fault_clips import ONE, SETTINGS, SEVERAL, Clip
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.rng import stream

Change = Callable[[Clip, np.random.Generator], Clip]
CALIBRATED = (ONE, SEVERAL)
OTHER_SIDE = [
    JOINT_NAMES.index(name.replace("left", "r#").replace("right", "left").replace("r#", "right"))
    for name in JOINT_NAMES
]
"""The joint of the other side, by joint."""
_LEGS = [k for k, name in enumerate(JOINT_NAMES) if name.endswith(("hip", "knee", "ankle", "pelvis"))]
_PERMUTATION = np.random.default_rng(1).permutation(len(JOINT_NAMES))


@dataclass(frozen=True)
class Fault:
    """A fault. sentence : describes it. change : applies it. settings : in which it is possible. survives : it must not
    end in a refusal. mirrors : a mirror image of the truth is right, as a single camera cannot show the difference."""

    sentence: str
    change: Change
    settings: Sequence[str] = SETTINGS
    survives: bool = False
    mirrors: bool = False


def height(factor: float) -> Change:
    return lambda clip, _: replace(clip, height_m=round(factor * clip.height_m, 3))


def cameras(change: Callable[[Camera], Camera]) -> Change:
    return lambda clip, _: replace(clip, cameras=[change(camera) for camera in clip.cameras])


def focal_length(factor: float) -> Change:
    def change(camera: Camera) -> Camera:
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= factor
        return replace(camera, matrix=matrix)

    return cameras(change)


def unit(factor: float) -> Change:
    return cameras(lambda camera: replace(camera, translation=factor * camera.translation))


def in_world(axes: Sequence[Sequence[float]]) -> Change:
    """Return the change of the world's axes to these rows."""
    return cameras(lambda camera: replace(camera, rotation=camera.rotation @ np.array(axes, np.float64).T))


def inverse(camera: Camera) -> Camera:
    return replace(camera, rotation=camera.rotation.T, translation=camera.position)


def of_another_camera(clip: Clip, _: np.random.Generator) -> Clip:
    """Give every camera the calibration of the next one."""
    rig = clip.rig or clip.cameras
    pairs = zip(clip.cameras, [*rig[1:], rig[0]], strict=False)
    return replace(clip, cameras=[replace(other, name=camera.name) for camera, other in pairs])


def first_camera_turned(degrees: float) -> Change:
    """Turn the first camera about an axis between its image's axes."""

    def change(clip: Clip, _: np.random.Generator) -> Clip:
        first, *others = clip.cameras
        axis = np.radians(degrees) * np.array([0.6, 0.8, 0.0])
        turn = scipy.spatial.transform.Rotation.from_rotvec(axis).as_matrix()
        rotation = turn @ first.rotation
        return replace(
            clip, cameras=[replace(first, rotation=rotation, translation=-rotation @ first.position), *others]
        )

    return change


def keypoints(change: Callable[[FloatArray, Clip, np.random.Generator], FloatArray]) -> Change:
    """Return the change of the keypoints (V, F, J, 3) alone."""
    return lambda clip, rng: replace(clip, keypoints=change(clip.keypoints.copy(), clip, rng))


def sides_exchanged(rows: Callable[[int, np.random.Generator], BoolArray], views: slice = slice(None)) -> Change:
    """Exchange left and right in the frames of `rows`, of their number."""

    def change(clip: Clip, rng: np.random.Generator) -> Clip:
        chosen = np.zeros(clip.keypoints.shape[:2], bool)
        chosen[views] = rows(len(clip.images), rng)
        exchanged = chosen[..., None, None]
        landmarks = clip.landmarks
        if landmarks is not None:
            landmarks = np.where(exchanged, landmarks[:, :, OTHER_SIDE], landmarks)
        return replace(
            clip, keypoints=np.where(exchanged, clip.keypoints[:, :, OTHER_SIDE], clip.keypoints), landmarks=landmarks
        )

    return change


def flipped(u: bool, v: bool, landmarks: bool, mirrored: bool = False) -> Change:
    """Flip the images' axes; `landmarks`: also those of the landmarks, as a detector of the flipped image does;
    `mirrored`: which takes left for right."""

    def change(clip: Clip, _: np.random.Generator) -> Clip:
        pixels, size = clip.keypoints.copy(), clip.size
        for axis, flips in enumerate((u, v)):
            if flips:
                pixels[..., axis] = size[axis] - 1.0 - pixels[..., axis]
        world = clip.landmarks
        if world is not None and landmarks:
            world = world * [-1.0 if u else 1.0, -1.0 if v else 1.0, 1.0]
        if mirrored:
            pixels, world = pixels[:, :, OTHER_SIDE], None if world is None else world[:, :, OTHER_SIDE]
        return replace(clip, keypoints=pixels, landmarks=world)

    return change


def rate(factor: float) -> Change:
    return lambda clip, _: replace(clip, rate_hz=factor * clip.rate_hz)


def frames(shown: Callable[[int, np.random.Generator], IntArray], meant: bool) -> Change:
    """Show other frames than the clip's, by their numbers; `meant`: the estimate is to be that of the frames shown, and
    otherwise that of the clip's own."""

    def change(clip: Clip, rng: np.random.Generator) -> Clip:
        rows = shown(len(clip.images), rng)
        landmarks = None if clip.landmarks is None else clip.landmarks[:, rows]
        times = clip.times[rows] if meant else clip.times[: len(rows)]
        return replace(
            clip, keypoints=clip.keypoints[:, rows], landmarks=landmarks, images=clip.images[rows], times=times,
            other=clip.other[:, rows],
        )  # fmt: skip

    return change


def constant_detection(clip: Clip, _: np.random.Generator) -> Clip:
    landmarks = None if clip.landmarks is None else np.repeat(clip.landmarks[:, :1], len(clip.images), axis=1)
    return replace(clip, keypoints=np.repeat(clip.keypoints[:, :1], len(clip.images), axis=1), landmarks=landmarks)


def another_in_half(clip: Clip, _: np.random.Generator) -> Clip:
    """The detector sees another person instead in the second half."""
    half = len(clip.images) // 2
    mixed, world = clip.keypoints.copy(), clip.landmarks
    mixed[:, half:] = clip.other[:, half:, :, :3]
    if world is not None:
        world = world.copy()
        world[:, half:] = clip.other[:, half:, :, 3:]
    return replace(clip, keypoints=mixed, landmarks=world)


def people_exchanged(clip: Clip, rng: np.random.Generator) -> Clip:
    """Both people are detected, and exchange their numbers in the middle."""
    mixed, half = another_in_half(clip, rng), len(clip.images) // 2
    other = clip.other.copy()
    world = clip.other[..., 3:] if clip.landmarks is None else clip.landmarks
    other[:, half:] = np.concatenate([clip.keypoints, world], axis=3)[:, half:]
    return replace(mixed, people=[other if clip.landmarks is not None else other[..., :3]])


def outliers(fraction: float) -> Change:
    """Move a fraction of the joints to places anywhere in the image."""

    def change(pixels: FloatArray, clip: Clip, rng: np.random.Generator) -> FloatArray:
        chosen = rng.random(pixels.shape[:3]) < fraction
        pixels[chosen, :2] = rng.uniform(0.0, np.array(clip.size) - 1.0, (chosen.sum(), 2))
        return pixels

    return keypoints(change)


def noise(heights: float) -> Change:
    """Add independent noise of this standard deviation along both axes, in heights of the person."""

    def change(pixels: FloatArray, clip: Clip, rng: np.random.Generator) -> FloatArray:
        sigma_px = heights * clip.heights_px[:, None, None, None]
        pixels[..., :2] += sigma_px * rng.standard_normal(pixels[..., :2].shape)
        return pixels

    return keypoints(change)


def gap(pixels: FloatArray, clip: Clip, _: np.random.Generator) -> FloatArray:
    n = len(clip.images)
    first = (n - round(clip.rate_hz)) // 2
    pixels[:, first : first + round(clip.rate_hz)] = np.nan
    return pixels


def legs_only(pixels: FloatArray, _clip: Clip, _: np.random.Generator) -> FloatArray:
    others = [k for k in range(len(JOINT_NAMES)) if k not in _LEGS]
    pixels[:, :, others] = np.nan
    return pixels


def low_confidence(pixels: FloatArray, _clip: Clip, rng: np.random.Generator) -> FloatArray:
    pixels[..., 2] *= rng.uniform(0.05, 0.25, pixels.shape[:3])
    return pixels


def random_points(pixels: FloatArray, clip: Clip, rng: np.random.Generator) -> FloatArray:
    pixels[..., :2] = rng.uniform(0.0, np.array(clip.size) - 1.0, pixels[..., :2].shape)
    return pixels


def half_resolution(pixels: FloatArray, _clip: Clip, _: np.random.Generator) -> FloatArray:
    pixels[..., :2] = (pixels[..., :2] + 0.5) / 2.0 - 0.5
    return pixels


def permuted(clip: Clip, _: np.random.Generator) -> Clip:
    landmarks = None if clip.landmarks is None else clip.landmarks[:, :, _PERMUTATION]
    return replace(clip, keypoints=clip.keypoints[:, :, _PERMUTATION], landmarks=landmarks)


def _all(n: int, _: np.random.Generator) -> BoolArray:
    return np.ones(n, bool)


def _second_half(n: int, _: np.random.Generator) -> BoolArray:
    return np.arange(n) >= n // 2


def _random(n: int, rng: np.random.Generator) -> BoolArray:
    return np.asarray(rng.random(n) < 0.5)


def _dropped(n: int, rng: np.random.Generator) -> IntArray:
    return np.flatnonzero((rng.random(n) > 0.3) | (np.arange(n) == 0))


_Y_UP = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
_LEFT_HANDED = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
FAULTS: Mapping[str, Fault] = {
    "height × ½": Fault("the person's height is given as half", height(0.5)),
    "height × 2": Fault("the person's height is given as twice", height(2.0)),
    "height − 25 %": Fault("the person's height is given 25 % too small", height(0.75)),
    "height + 25 %": Fault("the person's height is given 25 % too large", height(1.25)),
    "focal length × ½": Fault("the calibration's focal lengths are half", focal_length(0.5), CALIBRATED),
    "focal length × 2": Fault("the calibration's focal lengths are twice", focal_length(2.0), CALIBRATED),
    "another calibration": Fault("the calibration is that of other cameras", of_another_camera, CALIBRATED),
    **{
        f"unit {name}": Fault(f"the calibration is in {name}", unit(factor), CALIBRATED)
        for name, factor in {"mm": 1e3, "cm": 1e2, "inch": 39.37, "feet": 3.281, "km": 1e-3}.items()
    },
    "y up": Fault("the calibration's world has y up", in_world(_Y_UP), CALIBRATED),
    "left-handed": Fault("the calibration's world is left-handed", in_world(_LEFT_HANDED), CALIBRATED),
    "inverse pose": Fault("the calibration has the cameras' poses in the world", cameras(inverse), CALIBRATED),
    "camera turned by 2°": Fault("one of several cameras was turned by 2°", first_camera_turned(2.0), (SEVERAL,)),
    "camera turned by 5°": Fault("one of several cameras was turned by 5°", first_camera_turned(5.0), (SEVERAL,)),
    "sides exchanged": Fault("left and right are exchanged", sides_exchanged(_all)),
    "sides exchanged in half": Fault("left and right are exchanged in the second half", sides_exchanged(_second_half)),
    "sides exchanged at random": Fault("left and right are exchanged in half of the frames", sides_exchanged(_random)),
    "sides exchanged in a camera": Fault(
        "left and right are exchanged in one of several cameras", sides_exchanged(_all, slice(0, 1)), (SEVERAL,)
    ),
    "mirrored": Fault("the images are mirrored", flipped(True, False, True, mirrored=True), mirrors=True),
    "upside down": Fault("the images are upside down", flipped(True, True, True)),
    "y flipped": Fault("the keypoints' v points up", flipped(False, True, False)),
    "half resolution": Fault("the keypoints are those of images of half the size", keypoints(half_resolution)),
    **{
        f"rate × {name}": Fault(f"the video's rate is {name} times the true one", rate(factor))
        for name, factor in {"2": 2.0, "4": 4.0, "½": 0.5, "¼": 0.25}.items()
    },
    "reversed": Fault("the frames are in reversed order", frames(lambda n, _: np.arange(n)[::-1], meant=True)),
    "shuffled": Fault("the frames are shuffled", frames(lambda n, rng: rng.permutation(n), meant=True)),
    "dropped": Fault("30 % of the frames are missing without notice", frames(_dropped, meant=True)),
    "stuttering": Fault("every image is repeated twice", frames(lambda n, _: np.arange(n) // 3 * 3, meant=False)),
    "frozen in half": Fault(
        "the video is frozen in the second half", frames(lambda n, _: np.minimum(np.arange(n), n // 2), meant=False)
    ),
    "constant detection": Fault("the detections are those of the first frame", constant_detection),
    "another person in half": Fault("the detections are another person's in the second half", another_in_half),
    "people exchanged": Fault("two people exchange their numbers in the middle", people_exchanged),
    "20 % outliers": Fault("20 % of the keypoints are anywhere", outliers(0.2), survives=True),
    "50 % outliers": Fault("50 % of the keypoints are anywhere", outliers(0.5), survives=True),
    "noise of 5 %": Fault("the keypoints have noise of 5 % of the height", noise(0.05)),
    "noise of 15 %": Fault("the keypoints have noise of 15 % of the height", noise(0.15)),
    "gap": Fault("no person is detected for a second", keypoints(gap)),
    "legs only": Fault("only legs are detected", keypoints(legs_only)),
    "low confidence": Fault("all detections have low confidence", keypoints(low_confidence)),
    "random points": Fault("the keypoints are random", keypoints(random_points)),
    "permuted joints": Fault("the joints have each other's names", permuted),
}
"""The faults by name."""


def faulty(clip: Clip, name: str) -> Clip:
    """Return a clip with a fault; the random numbers depend on the fault's name alone."""
    return FAULTS[name].change(clip, stream(0, name))
