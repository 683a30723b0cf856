"""A take: the stretch of someone's movement that a dataset of points shows, and what it lets be known of the start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person
from workbench.core.frame import Truth
from workbench.datasets.scenes.scene import Scene
from workbench.datasets.scenes.splice import splice
from workbench.errors import InputError
from workbench.mocap.full_skeleton import full_body, full_poses
from workbench.mocap.motion import Motion
from workbench.mocap.named import find_motion, motion_file
from workbench.mocap.sources import UNKNOWN, read_clip
from workbench.streams import stream

STARTS = ("auto", "given")
SKELETONS = ("person", "full")
"""The person of 25 numbers, or the motion file's own skeleton with every joint."""
START_SIGMA_M, START_SIGMA_RAD = 0.03, 0.05
"""How far off the pose is that is given to start from: a person sets a figure by hand, roughly."""
_FINE = 4
"""Clips are spliced, and their cycles found, at this multiple of the dataset's rate."""


@dataclass(frozen=True, eq=False)
class Take:
    """What a person does in the F frames of a dataset. motion: at the dataset's rate. truths: F.

    body: the person's, or of the motion file's full skeleton; the poses (F, P) of motion and truths are this body's.
    phases: (F,) cycles, see `splice.Spliced`.
    """

    motion: Motion
    body: Body
    truths: tuple[Truth, ...]
    phases: FloatArray

    @property
    def places(self) -> FloatArray:
        """The true joints (F, J, 3), m."""
        return np.stack([np.asarray(truth.joints) for truth in self.truths])

    @property
    def phase_ends(self) -> tuple[float, float] | None:
        """The phases of the first and the last frame, cycles, as paper D sets them by hand; None without a cycle."""
        first, last = float(self.phases[0]), float(self.phases[-1])
        return (first, last) if np.isfinite(first + last) else None

    def rough_start(self, seed: int) -> FloatArray:
        """The first pose (P,) with Gaussian errors of 3 cm in place and 0.05 rad in every angle, within the limits."""
        skeleton, pose = self.body.skeleton, self.motion.poses[0]
        sigma = np.full(len(pose), START_SIGMA_RAD)
        sigma[:3] = START_SIGMA_M
        error = sigma * stream(seed, "rough start").standard_normal(len(pose))
        rough: FloatArray = np.clip(pose + error, *skeleton.limits.T)
        return rough


def find_take(
    motion: str | Sequence[str], *, data: str | None, rate_hz: float, n_frames: int, first_frame: int = 0,
    path: str = "straight", seed: int = 0, skeleton: str = "person",
) -> Take:  # fmt: skip
    """n_frames at rate_hz of the motion of that name, or of several spliced, from first_frame on, counted at rate_hz.

    Names, data, path and seed: see `motions.find_motion`. Every frame's truth has pose, joints and, where the clip
    says so, the activity. skeleton: one of SKELETONS; "full" takes one motion only, which has a file.

    Raises InputError for a motion that cannot be found or is too short, and another skeleton.
    """
    if skeleton not in SKELETONS:
        raise InputError(f"dataset: skeleton must be one of {', '.join(SKELETONS)}, found {skeleton!r}")
    names = motion_names(motion)
    clips = [find_motion(name, data=data, rate_hz=_FINE * rate_hz, path=path, seed=seed) for name in names]
    fine = splice(clips, _FINE * (n_frames - 1) + 1, _FINE * first_frame)
    shown = replace(fine.motion, rate_hz=rate_hz, poses=fine.motion.poses[::_FINE])
    body = person(shown.shape)
    if skeleton == "full":
        if len(names) > 1:
            raise InputError(f"dataset: skeleton=full shows one motion, found {len(names)} to splice")
        body, poses = _own_skeleton(clips[0], motion_file(names[0], data))
        shown = replace(shown, poses=poses[_FINE * first_frame :: _FINE][:n_frames])
    places = joints(body.skeleton, shown.poses)
    activities = [clips[k].activity for k in fine.clips[::_FINE]]
    truths = tuple(
        Truth(pose=pose, joints=place, activity=None if activity == UNKNOWN else activity)
        for pose, place, activity in zip(shown.poses, places, activities, strict=True)
    )
    return Take(shown, body, truths, fine.phases[::_FINE])


def take_of(scene: Scene, skeleton: str = "person") -> Take:
    """Tell what the person of a scene does, see `find_take`."""
    return find_take(
        scene.motion, data=scene.data, rate_hz=scene.rate_hz, n_frames=scene.n_frames, first_frame=scene.first_frame,
        path=scene.path, seed=scene.seed, skeleton=skeleton,
    )  # fmt: skip


def _own_skeleton(motion: Motion, file: Path) -> tuple[Body, FloatArray]:
    """The body of a motion file's own skeleton, and its poses (F, P) at the rate of `motion`, the same retargeted."""
    clip = read_clip(file)
    poses = replace(motion, rate_hz=clip.rate_hz, poses=full_poses(clip)).resampled(motion.rate_hz).poses
    return full_body(clip, motion.shape), poses


def motion_names(motion: str | Sequence[str]) -> list[str]:
    """The names of the motions that take turns; InputError where there is none."""
    names = [motion] if isinstance(motion, str | int) else list(motion)
    if not names:
        raise InputError("dataset: motion must name at least one motion, found none")
    return [str(name) for name in names]


def given_start(
    dataset: str, start: str, take: Take | None, seed: int
) -> tuple[FloatArray | None, tuple[float, float] | None]:
    """What is offered of the start: with start="given" the rough first pose (P,) and the phase's ends; else nothing.

    Raises InputError, naming the dataset, where `start` is unknown or asks for a truth that is not there.
    """
    if start not in STARTS:
        raise InputError(f"{dataset}: start must be one of {', '.join(STARTS)}, found {start!r}")
    if start == "auto":
        return None, None
    if take is None:
        raise InputError(f"{dataset}: start=given needs the truth, which is not known; use start=auto")
    if take.phase_ends is None:
        raise InputError(
            f"{dataset}: start=given gives the ends of the gait's phase, but {take.motion.name!r} has no gait cycle; "
            "use start=auto"
        )
    return take.rough_start(seed), take.phase_ends
