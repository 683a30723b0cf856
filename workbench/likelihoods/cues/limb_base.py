"""Looks that judge poses by points on the limbs: several together place the points of all of them in one pass."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames, forward
from workbench.body.limbs import Body
from workbench.core.likelihood import Evaluation, Likelihood
from workbench.likelihoods.base import among_finite, finite_rows, those
from workbench.likelihoods.cues.limb_points import LimbPoints, limb_points_of_all
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class ViewJudge:
    """What judges poses by one view. samples: points (n, 2) of every patch. judge: gives log likelihoods (N,) from
    where these lie in N poses and, where there are some, from `beside`, points (n, 2) about the patches."""

    camera: Camera
    samples: FloatArray
    judge: Callable[..., FloatArray]
    beside: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class LimbLook:
    """A `PoseLook` by which the views of a frame judge where the limbs are seen; their log likelihoods add up."""

    name: str
    body: Body
    judges: Sequence[ViewJudge]
    then: Callable[[FloatArray], Likelihood]
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P), −∞ and a note for those not finite; the previous ones do not matter."""
        return evaluate_together([self], pose)[0]

    def remember(self, expected_pose: FloatArray) -> Likelihood:
        """The likelihood of the next frame."""
        return self.then(expected_pose)


def evaluate_together(looks: Sequence[LimbLook], pose: FloatArray) -> list[Evaluation]:
    """What each look at one body finds of poses (N, P) by itself."""
    finite = finite_rows(pose)
    frames = forward(looks[0].body.skeleton, those(pose, finite))
    judges = [judge for look in looks for judge in look.judges]
    placed = dict(zip(map(id, judges), _placed(looks[0].body, judges, frames), strict=True))
    n, evaluations = len(frames.positions), []
    for look in looks:
        log_prob = sum((judge.judge(*placed[id(judge)]) for judge in look.judges), np.zeros(n))
        evaluations.append(among_finite(look.name, finite, log_prob))
    return evaluations


def _placed(body: Body, judges: Sequence[ViewJudge], frames: JointFrames) -> list[list[LimbPoints]]:
    """The points that each judge asks for, placed in one pass a camera, and another beside the limbs."""
    asked: dict[tuple[int, bool], list[tuple[int, ViewJudge, FloatArray]]] = defaultdict(list)
    for i, judge in enumerate(judges):
        asked[id(judge.camera), False].append((i, judge, judge.samples))
        if judge.beside is not None:
            asked[id(judge.camera), True].append((i, judge, judge.beside))
    placed: list[list[LimbPoints]] = [[] for _ in judges]
    for beside in (False, True):
        for (_, aside), wanted in asked.items():
            if aside == beside:
                camera = wanted[0][1].camera
                points = limb_points_of_all(body, [samples for *_, samples in wanted], camera, frames, beside)
                for (i, *_), each in zip(wanted, points, strict=True):
                    placed[i].append(each)
    return placed
