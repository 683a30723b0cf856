"""Look for a limb elsewhere: a climb only reaches what is near, and an arm or a leg that is lost stays lost."""

import numpy as np

from workbench.body.kinematics import descendants
from workbench.body.skeleton import Skeleton
from workbench.core.likelihood import DenseLikelihood
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

REACH = 0.7
"""By how much a limb's angles may differ from those of the frame before, rad: their deviation."""
COST = 6.0
"""Of a leap, nats, beside that."""
LEAST_GAIN = 12.0
"""By how much the image must be likelier as layers, nats."""
HOPELESS = 20.0
"""By how much less likely the best place may be, nats, for it to be looked at more closely."""
FIRST, LATER, BEST = 120, (60, 60), 5
"""Places tried at first, and then about the BEST so far, NARROWER."""
NARROWER = (0.25, 0.12)


def leap(
    frame_likelihood: DenseLikelihood,
    skeleton: Skeleton,
    limb: IntArray,
    pose: FloatArray,
    before: FloatArray,
    rng: np.random.Generator,
) -> FloatArray | None:
    """Find a place for a limb, columns `limb` (k,) of the pose (P,), where all pixels of the frame are likelier by
    LEAST_GAIN, by how far it is from where it was `before` (P,); returns the pose, None where there is no such place.

    Places are drawn about the last one, and twice again about the best of them, so that what is found need not be near
    to where the limb is thought to be; but not again where even the best is less likely by HOPELESS.
    """
    moved, low, high = _moved(skeleton, limb), *skeleton.limits[limb].T
    places, scores, here = np.empty((0, len(limb))), np.empty(0), -np.inf
    for n, deviation in zip((FIRST, *LATER), (REACH, *NARROWER), strict=True):
        best = places[np.argsort(-scores)[:BEST]]
        around = best[rng.integers(0, len(best), n)] if len(best) else before[limb]
        tried = np.clip(around + deviation * rng.standard_normal((n, len(limb))), low, high)
        poses = np.repeat(pose[None], n + 1, axis=0)
        poses[1:, limb] = tried
        ratios = frame_likelihood.compare(poses, moved)
        here = ratios[0]
        places, scores = (
            np.concatenate([places, tried]),
            np.concatenate([scores, ratios[1:] - cost(tried, before[limb])]),
        )
        if scores.max() < here - HOPELESS:
            return None
    if not scores.max() >= here + LEAST_GAIN:
        return None
    found = pose.copy()
    found[limb] = places[np.argmax(scores)]
    return found


def cost(places: FloatArray, before: FloatArray) -> FloatArray:
    """What a leap of a limb (k,) to places (..., k) costs, nats."""
    return np.asarray(COST + 0.5 * (((places - before) / REACH) ** 2).sum(axis=-1))


def is_better(
    frame_likelihood: DenseLikelihood,
    n_joints: int,
    pose: FloatArray,
    leapt: FloatArray,
    limb: IntArray,
    before: FloatArray,
) -> bool:
    """Return whether a frame is likelier in the pose (P,) that was climbed to after a leap: by all its pixels alone, as
    a limb that hides behind others costs the points nothing, and one that is seen costs them something anywhere."""
    everything = np.ones(n_joints, dtype=np.bool_)
    ratios = frame_likelihood.compare(np.stack([pose, leapt]), everything)
    return bool(ratios[1] - ratios[0] - cost(leapt[limb], before[limb]) > LEAST_GAIN)


def _moved(skeleton: Skeleton, limb: IntArray) -> BoolArray:
    """Return which joints (J,) carry what a limb's angles move."""
    own = np.unique(skeleton.dof_joints[limb])
    below = descendants(skeleton)[own].any(axis=0)
    return np.asarray(below | np.isin(np.arange(len(skeleton.names)), own))
