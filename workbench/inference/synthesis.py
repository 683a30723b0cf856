"""Motion from a prior alone, step by step, without jumps and with feet on the ground (paper C, sections 5 and 7)."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
import scipy

from workbench.body.angles import wrapped
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import N_ROOT, POSE_NAMES, Skeleton
from workbench.core.capabilities import ALL_JOINTS, FIT, LOOKAHEAD_WINDOWS, START, UNIFORM_WEIGHTS, Traits, offering
from workbench.core.checks import at_least, check
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame
from workbench.core.keys import records_arguments
from workbench.core.prior import Prior
from workbench.core.side_information import POSE_HISTORY
from workbench.core.step import Step
from workbench.motion.models.windows import Windows
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

LIMIT_DEG = 25.0
"""What an angle may change by in a frame before it counts as a jump: 1 in 100 frames of recorded runs does more."""
CANDIDATES = 8
"""Draws that a look-ahead tries out for every frame."""
ANKLES = ("left_ankle", "right_ankle")
PLANTED_SPEED = 0.6
"""m/s: recorded ankles stay below it while the foot is flat, and pass 1 m/s within a frame or two before and after."""
REACH_M = 0.15
"""Higher above the ground an ankle is not planted however slowly it moves, as at the top of a jump."""
SETTLE = 0.5
"""Part of its distance to the ground's height that a planted ankle loses in a frame."""


@runtime_checkable
class _Recorded(Prior, Protocol):
    """A prior that goes on as one of the windows of recorded motion did, such as `priors.implicit.Implicit`. beta:
    temperature of its draws, of squared distances between whitened coefficients."""

    @property
    def windows(self) -> Windows: ...
    @property
    def beta(self) -> float: ...

    def start_after(self, poses: FloatArray, n: int) -> FloatArray:
        """Return N states (N, D) that have just gone through poses (d + 1, P) at the library's rate."""

    def rows_in(self, dt_s: float) -> int:
        """Return the library's frames in dt_s seconds; raises InputError unless it is a whole number."""

    def draw(self, probes: FloatArray, rng: np.random.Generator) -> IntArray:
        """Return an entry (N,) for each probe (N, b), whitened coefficients."""

    def predict(self, state: FloatArray, entries: IntArray, noise: FloatArray) -> FloatArray:
        """Return states (N, D) one library frame later when entries (N,) were drawn; noise: (N, P) standard normal."""

    def only(self, kept: BoolArray) -> Self:
        """Return this prior, drawing from the windows kept (n,) alone."""


@records_arguments
class Synthesis:
    """Draws one motion from a prior, a frame at a time: an inference that looks at no image.

    info: has the pose history, poses (F, P) up to the start. An implicit prior takes its first window from the last d +
    1 of them at the library's rate; where they are too few, it searches windows that end near the pose, and the first
    step warns. Other priors start from the pose alone.

    smoothing_s: time, s, in which what is left of a jump falls to 1/e; 0 leaves jumps as they are. The part of a
    frame's change of an angle beyond LIMIT_DEG counts as a jump, is held back as an offset and let go bit by bit. The
    prior goes on from its own pose, not from the smoothed one.

    look_ahead: frames, of an implicit prior only; 0: none. Windows that fewer recorded frames follow are never drawn.
    Of CANDIDATES draws, each followed for so many frames, one is chosen with odds exp(−|c_i − c_t|² / 2β), the square
    being the mean over the frames ahead: a dead end is not taken. foot_contact: hold a planted foot in place, see
    `FootContact`; the ground is where the lead-in's lowest ankle was, or without one the starting pose's.

    Raises InputError for numbers out of range and a look-ahead with a prior that has none.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of a start and of a prior, to look ahead in where asked for; it plants a person's feet."""
        ahead = (LOOKAHEAD_WINDOWS,) if keys.get("look_ahead") else ()
        return offering(UNIFORM_WEIGHTS, FIT, dataset=START, prior=ahead, known=POSE_HISTORY, without=ALL_JOINTS)

    finds_start: ClassVar[bool] = False

    def __init__(
        self, prior: Prior, body: Body, info: SequenceInfo | None = None, *, smoothing_s: float = 0.1,
        look_ahead: int = 0, foot_contact: bool = True,
    ) -> None:  # fmt: skip
        self.smoothing_s, self.look_ahead = smoothing_s, look_ahead
        check("inference", self, smoothing_s=at_least(0), look_ahead=at_least(0))
        self.prior = _with_followers(prior, look_ahead) if look_ahead else prior
        self.skeleton, self.space, self.foot_contact = body.skeleton, prior.space, foot_contact
        self.info = SequenceInfo("", 0) if info is None else info

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step of one particle per frame, the first one at the pose `start` (P,), or the first of
        several (n, P).

        rng_streams: generators named "start" and "prior". A step's particle is the prior's own state, its pose the one
        after smoothing and foot contact. Diagnostics, from the second frame on: jump_deg, the largest change of a
        joint angle, degrees; of an implicit prior with a lead-in of a known activity same_activity, 1 where the entries
        drawn come from clips of it and 0 where not. Such a prior's steps tell the activity of the last entry's clip.
        Raises InputError without a start.
        """
        if start is None:
            raise InputError("inference: synthesis needs a pose to start from, found none")
        start = np.atleast_2d(start)[0]  # the likeliest of several
        smoother = Smoother(self.smoothing_s, np.radians(LIMIT_DEG))
        before = start[None] if self.info.pose_history is None else self.info.pose_history
        contact = FootContact(self.skeleton, float(ankle_positions(self.skeleton, before)[..., 2].min()))
        activity = self.info.pose_history_activity if isinstance(self.prior, _Recorded) else None
        time_s, shown, state = 0.0, start, np.empty((0, 0))
        for count, frame in enumerate(frames):
            warnings, diagnostics, dt_s = tuple[str, ...](), dict[str, float](), frame.time_s - time_s
            if count == 0:
                state, warnings = self._start(start, rng_streams["start"])
            else:
                state, diagnostics, activity = self._advance(state, dt_s, rng_streams["prior"])
            pose = smoother.follow(self.prior.pose(state)[0], dt_s)
            pose = contact.follow(pose, dt_s) if self.foot_contact else pose
            if count > 0:
                diagnostics = {"jump_deg": jump_deg(shown, pose), **diagnostics}
            time_s, shown = frame.time_s, pose
            yield Step(
                frame=frame, space=self.space, particles=state, poses=pose[None], log_weights=np.zeros(1),
                ancestors=np.zeros(1, dtype=np.int64), expected_pose=pose, map_pose=pose, ess=1.0, log_evidence=np.nan,
                diagnostics=diagnostics, warnings=warnings, activity=activity,
            )  # fmt: skip

    def _start(self, pose: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, tuple[str, ...]]:
        """Return a state (1, D) at the pose (P,), and what there is to say about it."""
        if not isinstance(self.prior, _Recorded):
            return self.prior.sample_initial(pose, 1, rng), ()
        library_hz, n_poses = self.prior.windows.rate_hz, self.prior.windows.window_frames + 1
        poses = np.empty((0, len(pose)))
        if self.info.pose_history is not None and self.info.rate_hz is not None:
            poses = _backwards(self.info.pose_history, self.info.rate_hz, library_hz)[:n_poses][::-1]
        if len(poses) == n_poses:
            return self.prior.start_after(poses, 1), ()
        sentence = (
            f"the motion before the start has {len(poses)} of the {n_poses} frames of an implicit prior's first "
            "window; started with a recorded window that ends near the pose"
        )
        return self.prior.sample_initial(pose, 1, rng), (sentence,)

    def _advance(
        self, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, dict[str, float], str | None]:
        """Return the state (1, D) dt_s seconds later, the step's diagnostics, and the activity of what was drawn."""
        if not isinstance(self.prior, _Recorded):
            return self.prior.sample_transition(state, dt_s, rng), {}, None
        same, drawn, info = True, None, self.info.pose_history_activity
        for _ in range(self.prior.rows_in(dt_s)):
            state, entry = _draw(self.prior, state, self.look_ahead, rng)
            windows = self.prior.windows
            drawn = windows.activities[windows.clip_of[entry]]
            same &= drawn == info
        return state, {} if info is None else {"same_activity": float(same)}, drawn


class Smoother:
    """Holds the jumps of one motion's angles back as offsets and lets go of them, see `Synthesis`. limit: rad a frame.
    Turns by 2π are no change, so that the angles that come out go on without them."""

    def __init__(self, smoothing_s: float, limit: float) -> None:
        self.smoothing_s, self.limit = smoothing_s, limit
        self.offset = np.zeros(len(POSE_NAMES) - 3)
        self._last: FloatArray | None = None
        self._shown = np.zeros(len(POSE_NAMES) - 3)

    def follow(self, pose: FloatArray, dt_s: float) -> FloatArray:
        """Return the next pose (P,), `dt_s` seconds after the one before, with its jumps held back."""
        angles = pose[3:]
        if self._last is None or self.smoothing_s == 0.0:
            self._last = self._shown = angles
            return pose
        change = wrapped(angles - self._last)
        jump = change - change.clip(-self.limit, self.limit)
        let_go = (1.0 - np.exp(-dt_s / self.smoothing_s)) * self.offset
        self.offset = self.offset - let_go - jump
        self._last, self._shown = angles, self._shown + change - jump - let_go
        return np.concatenate([pose[:3], self._shown])


class FootContact:
    """Shifts the root of one motion, frame by frame, so that the planted ankle rests on the ground.

    The lower of the ankles that move slower than PLANTED_SPEED, in the motion as it came, is planted: the root is
    shifted so that it stays where it came down, and within a few frames at the ground's height, until it moves faster
    again. The shift then stays, so that the motion does not jump. One ankle is held at a time. Angles are left alone,
    so that a foot's roll is lost.

    ground_m: height of a standing person's ankles, m. planted: which of ANKLES is held, None in the air.
    """

    def __init__(self, skeleton: Skeleton, ground_m: float) -> None:
        self._skeleton, self._ground_m = skeleton, ground_m
        self._shift = np.zeros(3)
        self._last: FloatArray | None = None
        self.planted: int | None = None
        self._anchor = np.zeros(3)

    def follow(self, pose: FloatArray, dt_s: float) -> FloatArray:
        """Return the next pose (P,), `dt_s` seconds after the one before, with its root shifted."""
        ankles = ankle_positions(self._skeleton, pose[None])[0]
        if self._last is not None:
            self._plant(ankles, np.linalg.norm(ankles - self._last, axis=1) / dt_s)
        self._last = ankles
        if self.planted is not None:
            self._anchor[2] += SETTLE * (self._ground_m - self._anchor[2])
            self._shift = self._anchor - ankles[self.planted]
        shifted = pose.copy()
        shifted[:3] += self._shift
        return shifted

    def _plant(self, ankles: FloatArray, speeds: FloatArray) -> None:
        if self.planted is not None and speeds[self.planted] < PLANTED_SPEED:
            return
        places = ankles + self._shift
        slow = (speeds < PLANTED_SPEED) & (places[:, 2] < self._ground_m + REACH_M)
        self.planted = int(np.where(slow, places[:, 2], np.inf).argmin()) if slow.any() else None
        if self.planted is not None:
            self._anchor = places[self.planted].copy()


def ankle_positions(skeleton: Skeleton, poses: FloatArray) -> FloatArray:
    """Return both ankles (N, 2, 3), m, of poses (N, P)."""
    return joints(skeleton, poses)[:, [skeleton.joint(name) for name in ANKLES]]


def jump_deg(before: FloatArray, after: FloatArray) -> float:
    """Return the largest change of a joint angle from one pose (P,) to the next, degrees; whole turns are no change."""
    return float(np.degrees(np.abs(wrapped(after[N_ROOT:] - before[N_ROOT:])).max()))


def _draw(prior: _Recorded, state: FloatArray, ahead: int, rng: np.random.Generator) -> tuple[FloatArray, int]:
    """Draw the state (1, D) a library frame later, and its entry; of CANDIDATES by what follows, if ahead > 0."""
    states = np.repeat(state, CANDIDATES if ahead else 1, axis=0)
    firsts, entries, _ = _one_frame(prior, states, rng)
    states, squares = firsts, np.zeros(len(firsts))
    for _ in range(ahead):
        states, _, square = _one_frame(prior, states, rng)
        squares += square / ahead
    odds = np.exp((squares.min() - squares) / (2.0 * prior.beta)).cumsum()
    chosen = min(int(np.searchsorted(odds, rng.random() * odds[-1], side="right")), len(odds) - 1) if ahead else 0
    return firsts[chosen : chosen + 1], int(entries[chosen])


def _one_frame(
    prior: _Recorded, states: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Draw states (N, D) a library frame later, with their entries (N,) and squared whitened distances (N,)."""
    probes = states[:, prior.space.slices["coefficients"]]
    entries = prior.draw(probes, rng)
    squares = ((prior.windows.coefficients[entries] - probes) ** 2).sum(axis=1)
    return prior.predict(states, entries, rng.standard_normal((len(states), len(POSE_NAMES)))), entries, squares


def _with_followers(prior: Prior, frames: int) -> _Recorded:
    if not isinstance(prior, _Recorded):
        raise InputError("inference: look_ahead is for the implicit prior; set inference.look_ahead=0")
    kept = prior.windows.followers >= frames
    if not kept.any():
        raise InputError(f"inference: look_ahead: no window of the database is followed by {frames} frames")
    return prior.only(kept)


def _backwards(poses: FloatArray, rate_hz: float, wanted_hz: float) -> FloatArray:
    """Return poses (F, P) from the last one back, by cubic splines at another rate."""
    poses = poses[::-1]
    if len(poses) < 2 or rate_hz == wanted_hz:
        return poses
    times = np.arange(len(poses)) / rate_hz
    wanted = np.arange(int(np.floor(times[-1] * wanted_hz + 1e-9)) + 1) / wanted_hz
    return np.asarray(scipy.interpolate.CubicSpline(times, poses)(wanted))
