"""A rendered walker, and the dense likelihood after two frames at their true poses."""

from functools import cache

from workbench.core.frame_cache import FrameCache
from workbench.datasets.synthetic import Synthetic
from workbench.likelihoods.dense.dense_alignment import DenseAlignment


@cache
def walker():
    return Synthetic(motion="builtin", n_frames=6, perturb=False, width=320, height=240, person_px=150.0, seed=3)


@cache
def tracked():
    """Return the likelihood after two frames, and all frames."""
    clip = FrameCache(walker())
    likelihood, frames = DenseAlignment(walker().body, clip), list(clip)
    for before, frame in zip((None, frames[0]), frames[:2], strict=True):
        likelihood = likelihood.prepare(before, frame).update(frame.truth.pose)
    return likelihood, frames


def third_frame():
    """Return the third frame's likelihood and its true pose."""
    likelihood, frames = tracked()
    return likelihood.prepare(frames[1], frames[2]), frames[2].truth.pose
