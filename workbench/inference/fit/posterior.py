"""The steps of a fit: particles drawn from each frame's Gaussian posterior."""

from collections.abc import Iterator, Sequence

import numpy as np

from workbench.arrays import FloatArray
from workbench.core.frame import Frame
from workbench.core.step import Step
from workbench.inference.fit.task import Fit


def steps(fit: Fit, frames: Sequence[Frame], n_particles: int, rng: np.random.Generator) -> Iterator[Step]:
    """Yield one step per frame: particles drawn from the Gaussian posterior of its state, with even weights.

    Poses are drawn by the same numbers through the derivative at the fit, so that theirs is the Gaussian of
    `Fit.covariance`. The expected pose is the fit. Frames are drawn independently of each other, so that an ancestor
    means nothing. Phases are shown from the cycle they are in.
    """
    even, ancestors = np.full(n_particles, -np.log(n_particles)), np.arange(n_particles)
    phase = fit.space.slices.get("phase", slice(0))
    for t, frame in enumerate(frames):
        draws = rng.standard_normal((n_particles, len(fit.space))) @ _root(fit.state_covariance[t]).T
        state = fit.states[t].copy()
        state[phase] %= 1.0
        diagnostics = {"inliers": float(np.nan_to_num(fit.inliers[t])), "iterations": fit.iterations}
        yield Step(
            frame=frame, space=fit.space, particles=state + draws,
            poses=fit.poses[t] + draws @ fit.pose_jacobian[t].T, log_weights=even, ancestors=ancestors,
            expected_pose=fit.poses[t], map_pose=fit.poses[t], ess=float(n_particles), log_evidence=np.nan,
            diagnostics=diagnostics, evaluations=fit.iterations,
            timing_s={stage: s / len(frames) for stage, s in fit.timing_s.items()},
        )  # fmt: skip


def _root(covariance: FloatArray) -> FloatArray:
    """A with A Aᵀ the covariance (D, D), by eigenvalues, as it may be singular to rounding."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(values.clip(min=0.0))
    return root
