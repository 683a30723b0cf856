"""Motion synthesis from a prior alone, with jump blending and ground contact (paper C, sections 5 and 7)."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
import scipy

from workbench.body.angles import wrapped
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import N_ROOT, POSE_NAMES, Skeleton
from workbench.core.capabilities import (
    ALL_JOINTS,
    FIT,
    LOOKAHEAD_WINDOWS,
    START,
    UNIFORM_WEIGHTS,
    Traits,
    component_traits,
)
from workbench.core.checks import at_least, check
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame
from workbench.core.prior import Prior
from workbench.core.side_information import POSE_HISTORY
from workbench.core.step import Step
from workbench.motion.models.windows import Windows
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

JUMP_THRESHOLD_DEG = 25.0
"""Largest change of an angle in a frame that is not a jump; 1 in 100 frames of recorded runs exceeds it."""
N_CANDIDATES = 8
"""Samples per frame that a look-ahead compares."""
ANKLES = ("left_ankle", "right_ankle")
PLANTED_SPEED = 0.6
"""m/s: recorded ankles are slower while the foot is flat, and faster than 1 m/s within two frames before and after."""
MAX_PLANTED_HEIGHT_M = 0.15
"""An ankle higher above the ground is not planted at any speed, as at the top of a jump."""
GROUND_RATE = 0.5
"""Fraction of its distance to the ground's height that a planted ankle loses per frame."""


@runtime_checkable
class _WindowPrior(Prior, Protocol):
    """A prior that samples continuations of recorded motion windows, such as `priors.implicit.Implicit`. beta:
    temperature of the sampling, of squared distances between whitened coefficients."""

    @property
    def windows(self) -> Windows: ...
    @property
    def beta(self) -> float: ...

    def start_after(self, poses: FloatArray, n: int) -> FloatArray:
        """Return N states (N, D) after the poses (d + 1, P) at the library's rate."""

    def rows_in(self, dt_s: float) -> int:
        """Return the number of library frames in dt_s seconds; raises InputError unless it is an integer."""

    def draw(self, probes: FloatArray, rng: np.random.Generator) -> IntArray:
        """Return a sampled entry (N,) for each probe (N, b), whitened coefficients."""

    def predict(self, state: FloatArray, entries: IntArray, noise: FloatArray) -> FloatArray:
        """Return states (N, D) one library frame later, given the sampled entries (N,); noise: (N, P) standard
        normal."""

    def only(self, mask: BoolArray) -> Self:
        """Return this prior, restricted to the windows in a mask (n,)."""


class Synthesis:
    """Sample one motion from a prior, frame by frame; an inference that ignores the images.

    info: has the pose history, poses (F, P) up to the start. An implicit prior takes its first window from the last d +
    1 of them at the library's rate; if they are too few, it searches windows that end near the pose, with a warning in
    the first step. Other priors start from the pose alone.

    blend_time_s: time, s, in which the offset of a jump decays to 1/e; 0 leaves jumps unchanged. The part of a frame's
    change of an angle beyond JUMP_THRESHOLD_DEG is a jump, which is subtracted as a decaying offset. The prior
    continues from its own pose, not from the blended one.

    look_ahead: frames, of an implicit prior only; 0: none. Windows with fewer subsequent frames are excluded. Of
    N_CANDIDATES samples, each continued for so many frames, one is selected with probability ∝ exp(−|c_i − c_t|² / 2β)
    with the mean square over the frames ahead, which avoids dead ends. foot_contact: keep a planted foot in place, see
    `FootContact`; the ground is at the lowest ankle of the pose history, or of the initial pose without one.

    Raises InputError for numbers out of range, and for a look-ahead with a prior that does not support it.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of an initial pose, of a person's feet, and of look-ahead windows if they are used."""
        windows = (LOOKAHEAD_WINDOWS,) if keys.get("look_ahead") else ()
        return component_traits(
            UNIFORM_WEIGHTS,
            FIT,
            dataset=START,
            prior=windows,
            optional_assumptions=POSE_HISTORY,
            excluded=ALL_JOINTS,
        )

    finds_start: ClassVar[bool] = False

    def __init__(
        self, prior: Prior, body: Body, info: SequenceInfo | None = None, *, blend_time_s: float = 0.1,
        look_ahead: int = 0, foot_contact: bool = True,
    ) -> None:  # fmt: skip
        self.blend_time_s, self.look_ahead = blend_time_s, look_ahead
        check("inference", self, blend_time_s=at_least(0), look_ahead=at_least(0))
        self.prior = _restricted_to_continued(prior, look_ahead) if look_ahead else prior
        self.skeleton, self.space, self.foot_contact = body.skeleton, prior.space, foot_contact
        self.info = SequenceInfo("", 0) if info is None else info

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step of one particle per frame, the first one at the pose `start` (P,), or the first of several (n,
        P).

        rng_streams: generators named "start" and "prior". A step's particle is the prior's own state; its pose includes
        blending and foot contact. Diagnostics, from the second frame on: jump_deg, the largest change of a joint angle,
        degrees; for an implicit prior with a pose history of known activity same_activity, 1 if the sampled entries are
        from clips of it, else 0. The activity of such a prior's steps is that of the last entry's clip. Raises
        InputError without a start.
        """
        if start is None:
            raise InputError("inference: synthesis needs an initial pose, found none")
        start = np.atleast_2d(start)[0]  # the best of several
        blending = JumpBlending(self.blend_time_s, np.radians(JUMP_THRESHOLD_DEG))
        poses_before = start[None] if self.info.pose_history is None else self.info.pose_history
        contact = FootContact(self.skeleton, float(ankle_positions(self.skeleton, poses_before)[..., 2].min()))
        activity = self.info.pose_history_activity if isinstance(self.prior, _WindowPrior) else None
        time_s, output_pose, state = 0.0, start, np.empty((0, 0))
        for count, frame in enumerate(frames):
            warnings, diagnostics, dt_s = tuple[str, ...](), dict[str, float](), frame.time_s - time_s
            if count == 0:
                state, warnings = self._start(start, rng_streams["start"])
            else:
                state, diagnostics, activity = self._advance(state, dt_s, rng_streams["prior"])
            pose = blending.update(self.prior.pose(state)[0], dt_s)
            pose = contact.update(pose, dt_s) if self.foot_contact else pose
            if count > 0:
                diagnostics = {"jump_deg": jump_deg(output_pose, pose), **diagnostics}
            time_s, output_pose = frame.time_s, pose
            yield Step(
                frame=frame, space=self.space, particles=state, poses=pose[None], log_weights=np.zeros(1),
                ancestors=np.zeros(1, dtype=np.int64), expected_pose=pose, map_pose=pose, ess=1.0, log_evidence=np.nan,
                diagnostics=diagnostics, warnings=warnings, activity=activity,
            )  # fmt: skip

    def _start(self, pose: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, tuple[str, ...]]:
        """Return a state (1, D) at the pose (P,), and warnings."""
        if not isinstance(self.prior, _WindowPrior):
            return self.prior.sample_initial(pose, 1, rng), ()
        library_hz, n_poses = self.prior.windows.rate_hz, self.prior.windows.window_frames + 1
        poses = np.empty((0, len(pose)))
        if self.info.pose_history is not None and self.info.rate_hz is not None:
            poses = _resampled_backwards(self.info.pose_history, self.info.rate_hz, library_hz)[:n_poses][::-1]
        if len(poses) == n_poses:
            return self.prior.start_after(poses, 1), ()
        message = (
            f"the motion before the start has {len(poses)} of the {n_poses} frames of an implicit prior's first "
            "window; started with a recorded window that ends near the pose"
        )
        return self.prior.sample_initial(pose, 1, rng), (message,)

    def _advance(
        self, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, dict[str, float], str | None]:
        """Return the state (1, D) dt_s seconds later, the step's diagnostics, and the activity of the last sampled
        entry."""
        if not isinstance(self.prior, _WindowPrior):
            return self.prior.sample_transition(state, dt_s, rng), {}, None
        same_activity, activity, info = True, None, self.info.pose_history_activity
        for _ in range(self.prior.rows_in(dt_s)):
            state, entry = _draw(self.prior, state, self.look_ahead, rng)
            windows = self.prior.windows
            activity = windows.activities[windows.clip_of[entry]]
            same_activity &= activity == info
        return state, {} if info is None else {"same_activity": float(same_activity)}, activity


class JumpBlending:
    """Subtracts the jumps of one motion's angles as decaying offsets, see `Synthesis`. threshold: rad per frame. Turns
    by 2π are no change, and the output angles are continuous."""

    def __init__(self, blend_time_s: float, threshold: float) -> None:
        self.blend_time_s, self.threshold = blend_time_s, threshold
        self.offset = np.zeros(len(POSE_NAMES) - 3)
        self._input_angles: FloatArray | None = None
        self._output_angles = np.zeros(len(POSE_NAMES) - 3)

    def update(self, pose: FloatArray, dt_s: float) -> FloatArray:
        """Return the next pose (P,), `dt_s` seconds after the previous one, with blended jumps."""
        angles = pose[3:]
        if self._input_angles is None or self.blend_time_s == 0.0:
            self._input_angles = self._output_angles = angles
            return pose
        change = wrapped(angles - self._input_angles)
        jump = change - change.clip(-self.threshold, self.threshold)
        decay = (1.0 - np.exp(-dt_s / self.blend_time_s)) * self.offset
        self.offset = self.offset - decay - jump
        self._input_angles, self._output_angles = angles, self._output_angles + change - jump - decay
        return np.concatenate([pose[:3], self._output_angles])


class FootContact:
    """Shifts the root of one motion, frame by frame, so that the planted ankle rests on the ground.

    The lower of the ankles slower than PLANTED_SPEED in the input motion is planted: the root is shifted so that the
    ankle stays at its landing position, and within a few frames at the ground's height, until it is faster again. The
    shift then remains, so that the motion is continuous. One ankle is planted at a time. Angles are unchanged, so that
    a foot does not roll.

    ground_m: height of a standing person's ankles, m. planted: index in ANKLES, None in the air.
    """

    def __init__(self, skeleton: Skeleton, ground_m: float) -> None:
        self._skeleton, self._ground_m = skeleton, ground_m
        self._shift = np.zeros(3)
        self._ankles: FloatArray | None = None
        self.planted: int | None = None
        self._anchor = np.zeros(3)

    def update(self, pose: FloatArray, dt_s: float) -> FloatArray:
        """Return the next pose (P,), `dt_s` seconds after the previous one, with a shifted root."""
        ankles = ankle_positions(self._skeleton, pose[None])[0]
        if self._ankles is not None:
            self._plant(ankles, np.linalg.norm(ankles - self._ankles, axis=1) / dt_s)
        self._ankles = ankles
        if self.planted is not None:
            self._anchor[2] += GROUND_RATE * (self._ground_m - self._anchor[2])
            self._shift = self._anchor - ankles[self.planted]
        shifted = pose.copy()
        shifted[:3] += self._shift
        return shifted

    def _plant(self, ankles: FloatArray, speeds: FloatArray) -> None:
        if self.planted is not None and speeds[self.planted] < PLANTED_SPEED:
            return
        positions = ankles + self._shift
        slow = (speeds < PLANTED_SPEED) & (positions[:, 2] < self._ground_m + MAX_PLANTED_HEIGHT_M)
        self.planted = int(np.where(slow, positions[:, 2], np.inf).argmin()) if slow.any() else None
        if self.planted is not None:
            self._anchor = positions[self.planted].copy()


def ankle_positions(skeleton: Skeleton, poses: FloatArray) -> FloatArray:
    """Return both ankles (N, 2, 3), m, of poses (N, P)."""
    return joints(skeleton, poses)[:, [skeleton.joint(name) for name in ANKLES]]


def jump_deg(before: FloatArray, after: FloatArray) -> float:
    """Return the largest change of a joint angle from one pose (P,) to the next, degrees; whole turns are no change."""
    return float(np.degrees(np.abs(wrapped(after[N_ROOT:] - before[N_ROOT:])).max()))


def _draw(prior: _WindowPrior, state: FloatArray, windows: int, rng: np.random.Generator) -> tuple[FloatArray, int]:
    """Return a sampled state (1, D) a library frame later, and its entry; selected from N_CANDIDATES by their
    continuations if windows > 0."""
    states = np.repeat(state, N_CANDIDATES if windows else 1, axis=0)
    first_states, entries, _ = _one_frame(prior, states, rng)
    states, squares = first_states, np.zeros(len(first_states))
    for _ in range(windows):
        states, _, square = _one_frame(prior, states, rng)
        squares += square / windows
    odds = np.exp((squares.min() - squares) / (2.0 * prior.beta)).cumsum()
    selected = min(int(np.searchsorted(odds, rng.random() * odds[-1], side="right")), len(odds) - 1) if windows else 0
    return first_states[selected : selected + 1], int(entries[selected])


def _one_frame(
    prior: _WindowPrior, states: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return sampled states (N, D) a library frame later, with their entries (N,) and squared whitened distances
    (N,)."""
    probes = states[:, prior.space.slices["coefficients"]]
    entries = prior.draw(probes, rng)
    squares = ((prior.windows.coefficients[entries] - probes) ** 2).sum(axis=1)
    return prior.predict(states, entries, rng.standard_normal((len(states), len(POSE_NAMES)))), entries, squares


def _restricted_to_continued(prior: Prior, frames: int) -> _WindowPrior:
    if not isinstance(prior, _WindowPrior):
        raise InputError("inference: look_ahead needs the implicit prior; set inference.look_ahead=0")
    long_enough = prior.windows.followers >= frames
    if not long_enough.any():
        raise InputError(f"inference: look_ahead: no window of the database is followed by {frames} frames")
    return prior.only(long_enough)


def _resampled_backwards(poses: FloatArray, rate_hz: float, output_hz: float) -> FloatArray:
    """Return poses (F, P) in reverse order, resampled by cubic splines to another rate."""
    poses = poses[::-1]
    if len(poses) < 2 or rate_hz == output_hz:
        return poses
    times = np.arange(len(poses)) / rate_hz
    output_times = np.arange(int(np.floor(times[-1] * output_hz + 1e-9)) + 1) / output_hz
    return np.asarray(scipy.interpolate.CubicSpline(times, poses)(output_times))
