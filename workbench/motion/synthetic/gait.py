"""Synthetic walkers from published gait curves, for tests and demonstrations without recordings.

Sources of the curves, one cycle from heel strike to heel strike of the same foot:
- hip and knee flexion, level walking at natural cadence: Winter, *Biomechanics and Motor Control of Human Movement*,
  4th ed. 2009; pelvis, and the hip in the frontal plane: Kadaba, Ramakrishnan & Wootten, *J. Orthop. Res.* 8, 1990;
- shoulder and elbow: Murray, Sepic & Barnard, *Phys. Ther.* 47, 1967.

The key values below are the papers' extremes and intermediate values to about 2°, not their tables. A monotone spline
through them is truncated to N_HARMONICS Fourier coefficients. Differences to the papers, because this torso is rigid:
published hip flexion is relative to the pelvis, which is tilted forwards by about 10°, whereas this torso leans by 3°,
so hip flexion is reduced by 7°; the torso rolls and turns less than a pelvis, since it carries the shoulders too. There
are no feet: the ankle, at its height over the sole, is the contact point with the ground.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from workbench.body.kinematics import joints
from workbench.body.shape import Shape, from_height
from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES, POSE_NAMES, person_skeleton, without_side
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

ComplexArray: TypeAlias = NDArray[np.complex128]
PATHS = ("straight", "circle")
RADIUS_M = 2.0  # of the circle
N_HARMONICS = 6
STANCE = 0.6  # duty factor of a foot: two double-support phases of a tenth of the cycle
_CYCLE = np.linspace(0.0, 1.0, 257)
_ANGLE_NAMES = POSE_NAMES[3:]
_ANKLES = [JOINT_NAMES.index("left_ankle"), JOINT_NAMES.index("right_ankle")]
ANKLE_HEIGHT = 0.039 / 0.246  # height of the ankle over the sole as a fraction of the calf (Drillis & Contini 1966)


@dataclass(frozen=True)
class GaitCurve:
    """One joint angle over a cycle: keys (percent of the cycle, degrees), and its variation between people.

    amplitude : half-width of the distribution of the curve's scale, as a fraction. offset : that of its mean, degrees.
    """

    keys: tuple[tuple[float, float], ...]
    amplitude: float
    offset: float


# A name without a side applies to both: the right side is half a cycle after the left.
GAIT_CURVES = {
    "root_heading": GaitCurve(((0, -3), (50, 3)), 0.4, 0.0),  # the hip of the striking foot is in front
    "root_pitch": GaitCurve(((0, 3.8), (25, 2.2), (50, 3.8), (75, 2.2)), 0.4, 1.5),
    "root_roll": GaitCurve(((0, 0.5), (15, 2), (50, -0.5), (65, -2)), 0.4, 0.0),  # the side of the stance leg rises
    "neck_turn": GaitCurve(((0, 3), (50, -3)), 0.4, 0.0),  # the head faces along the path
    "neck_nod": GaitCurve(((0, -2), (50, -2)), 0.4, 3.0),
    "neck_tilt": GaitCurve(((0, -0.5), (15, -2), (50, 0.5), (65, 2)), 0.4, 0.0),
    "shoulder_abduction": GaitCurve(((0, 4), (50, 9)), 0.4, 2.0),
    "shoulder_flexion": GaitCurve(((1, -24), (50, 8)), 0.4, 3.0),
    "shoulder_twist": GaitCurve(((0, 10), (50, 10)), 0.4, 8.0),
    "elbow_flexion": GaitCurve(((5, 18), (54, 42)), 0.4, 4.0),
    "hip_flexion": GaitCurve(
        ((0, 23), (5, 22.5), (10, 20.5), (20, 12), (30, 2), (40, -8), (50, -16.5), (54, -18), (60, -14),
         (70, 4), (80, 19), (86, 25), (95, 24)), 0.08, 2.0,
    ),
    "hip_abduction": GaitCurve(((0, -0.5), (15, -3.5), (30, -4.5), (45, -1.5), (62, 2.5), (80, 1)), 0.3, 1.0),
    "hip_twist": GaitCurve(((0, -3), (50, 3)), 0.4, 2.0),  # compensates the turn of the torso
    "knee_flexion": GaitCurve(
        ((0, 4), (7, 14), (14, 19), (20, 17.5), (30, 9.5), (40, 4.5), (50, 11), (60, 37), (66, 54), (72, 62),
         (80, 52), (90, 18), (97, 2)), 0.06, 1.5,
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class GaitSubject:
    """One synthetic walker or runner.

    stride_hz : strides (two steps) per second. phase : in the cycle at time zero, 0 to 1; 0 is the left heel strike.
    curves : (22, N_HARMONICS + 1) Fourier coefficients c_k, rad, of the angles POSE_NAMES[3:],
    angle(φ) = Re Σ_k c_k exp(2πi k φ).
    """

    name: str
    shape: Shape
    stride_hz: float
    phase: float
    curves: ComplexArray

    def angles(self, phases: FloatArray) -> FloatArray:
        """Return the angles (F, 22), rad, at phases (F,) in cycles; the root's heading is relative to the path."""
        waves = np.exp(2j * np.pi * np.outer(phases, np.arange(N_HARMONICS + 1)))
        return np.ascontiguousarray((waves @ self.curves.T).real)


def average_subject() -> GaitSubject:
    """Return the published curves on a person of 1.75 m at Winter's natural cadence, 106 steps per minute."""
    return GaitSubject("average", from_height(1.75), stride_hz=106 / 120, phase=0.0, curves=both_sides(GAIT_CURVES))


def subjects(n: int, rng: np.random.Generator) -> list[GaitSubject]:
    """Return `n` people who differ in size, proportions, cadence, stride, arm swing, posture and individual harmonics.

    Distributions are uniform, so that all angles stay within the joint limits. Faster walkers also have longer strides.
    """
    average = replace(average_subject(), stride_hz=0.92)
    return [variation(replace(average, name=f"walker_{i:02d}"), GAIT_CURVES, rng) for i in range(n)]


def variation(average: GaitSubject, published: Mapping[str, GaitCurve], rng: np.random.Generator) -> GaitSubject:
    """Return a subject of the same name with random size, stride and curves, within the variation in `published`."""
    shape = from_height(rng.uniform(1.58, 1.90))
    lengths = ("thigh", "calf", "upper_arm", "forearm")
    shape = replace(shape, **{key: getattr(shape, key) * rng.uniform(0.97, 1.03) for key in lengths})
    briskness = rng.uniform(-1.0, 1.0)
    scales = {key: 1.0 + curve.amplitude * rng.uniform(-1.0, 1.0) for key, curve in published.items()}
    scales["hip_flexion"] += 0.07 * briskness
    offsets = {key: np.radians(curve.offset) * rng.uniform(-1.0, 1.0) for key, curve in published.items()}
    curves = average.curves.copy()
    for row, dof in enumerate(_ANGLE_NAMES):
        curves[row, 1:] *= scales[without_side(dof)]
        curves[row, 0] += offsets[without_side(dof)]
    # individual variation: up to half a degree in each of the first four harmonics, per side
    harmonics = rng.uniform(-1.0, 1.0, (2, len(_ANGLE_NAMES), 4)) * np.radians(0.5)
    curves[:, 1:5] += harmonics[0] + 1j * harmonics[1]
    stride_hz = average.stride_hz * (1.0 + 0.06 * briskness + rng.uniform(-0.05, 0.05))
    return GaitSubject(average.name, shape, stride_hz, rng.uniform(), curves)


def walker(subject: GaitSubject, duration_s: float, rate_hz: float, path: str = "straight") -> Motion:
    """Return a walk of `subject` over the ground z = 0, from above the origin towards +x.

    The root's height keeps the lower ankle at its height over the sole. The root's speed keeps the stance foot at rest
    on the ground, so it follows from stride and cadence.

    Parameters
    ----------
    subject : the walker.
    duration_s, rate_hz : s, Hz.
    path : "straight", or "circle", to the left about (0, RADIUS_M).

    Raises
    ------
    InputError : an unknown path, fewer than two frames, or a rate that is not positive.
    """
    if path not in PATHS:
        raise InputError(f"walker: path must be one of {', '.join(PATHS)}, found {path!r}")
    times = frame_times("walker", duration_s, rate_hz)
    phases = subject.phase + subject.stride_hz * times
    curvature = 1.0 / RADIUS_M if path == "circle" else 0.0
    positions, heights, headings = _root_path(subject, phases, curvature)
    angles = subject.angles(phases)
    angles[:, 0] += headings
    poses = np.column_stack([positions, heights, angles])
    return generated(subject, path, "walk", rate_hz, poses, source=__name__)


def frame_times(context: str, duration_s: float, rate_hz: float) -> FloatArray:
    """Return the times (F,), s, of all frames in a duration; raises InputError for fewer than two."""
    if not (0.0 < rate_hz < np.inf and 1.0 <= duration_s * rate_hz < np.inf):
        raise InputError(f"{context}: expected at least two frames, found {duration_s} s at {rate_hz} Hz")
    return np.arange(int(np.floor(duration_s * rate_hz + 1e-9)) + 1) / rate_hz


def builtin_motions(n_subjects: int = 12, seed: int = 2000) -> tuple[Motion, ...]:
    """Return a small training library: `n_subjects` straight walks of 6 s (about five cycles) at 60 Hz."""
    people = subjects(n_subjects, np.random.default_rng(seed))
    return tuple(walker(person, duration_s=6.0, rate_hz=60.0) for person in people)


def generated(subject: GaitSubject, path: str, activity: str, rate_hz: float, poses: FloatArray, source: str) -> Motion:
    """Return the motion of a subject with poses (F, 25) generated by the module `source`."""
    return Motion(
        name=f"{subject.name}_{path}", subject=subject.name, activity=activity, rate_hz=rate_hz, poses=poses,
        shape=subject.shape, joint_error_mm=np.zeros(len(ERROR_JOINTS)), source=f"generated: {source}",
        sha256=hashlib.sha256(poses.tobytes()).hexdigest(),
        licence="generated by the workbench; not a recording",
    )  # fmt: skip


def _root_path(subject: GaitSubject, phases: FloatArray, curvature: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the root's positions (F, 2), heights (F,) and headings (F,) at equidistant phases (F,) in cycles.

    In the frame that rotates with the path, with heading rate ω per cycle, an ankle at p is at rest on the ground if
    the root's velocity is −(dp/dφ + ω ẑ × p). Half of the first term's oscillation about its mean is removed: a foot
    rolls from heel to toe and moves its ankle, and the velocity of a body on fixed ankles would fluctuate. The lateral
    means are removed too, so that the path is straight, or a circle tangent to the heading; on a circle of 2 m, feet
    then slip by 3 cm.
    """
    (feet, heights), load = _feet(subject), _load(_CYCLE)
    foot_velocity = -(scipy.interpolate.CubicSpline(_CYCLE, feet, bc_type="periodic")(_CYCLE, 1) * load).sum(axis=1)
    stride = foot_velocity[:-1, 0].mean()
    omega = curvature * stride
    centre = (feet * load).sum(axis=1)
    turning = omega * np.stack([centre[:, 1], -centre[:, 0]], axis=1)
    oscillation = 0.5 * (foot_velocity - foot_velocity[:-1].mean(axis=0)) + turning - turning[:-1].mean(axis=0)
    velocity = scipy.interpolate.CubicSpline(
        _CYCLE, _low_pass(oscillation, harmonics=4) + np.array([stride, 0.0]), bc_type="periodic"
    )

    fine = 8  # integration steps per frame
    dense = np.linspace(phases[0], phases[-1], (len(phases) - 1) * fine + 1)
    headings = omega * (dense - dense[0])
    c, s = np.cos(headings), np.sin(headings)
    forward, left = velocity(dense).T
    world = np.stack([c * forward - s * left, s * forward + c * left], axis=1)
    steps = 0.5 * (world[1:] + world[:-1]) * (dense[1] - dense[0])
    positions = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    height = scipy.interpolate.CubicSpline(_CYCLE, _low_pass(heights, harmonics=5), bc_type="periodic")(phases)
    return positions[::fine], height, headings[::fine]


def _feet(subject: GaitSubject) -> tuple[FloatArray, FloatArray]:
    """Return the ankles' positions (M, 2 feet, 2), m, forward and left of the root, and the root's height (M,) over
    _CYCLE.

    The height uses the smooth minimum −τ log Σ exp(−z/τ) of the two ankles, τ = 5 mm. It smooths the change of the
    stance foot, with an error of τ log 2 = 3.5 mm in double support.
    """
    poses = np.zeros((len(_CYCLE), len(POSE_NAMES)))
    poses[:, 3:] = subject.angles(_CYCLE)
    poses[-1] = poses[0]  # bitwise equal, as periodic splines require
    ankles = joints(person_skeleton(subject.shape), poses)[:, _ANKLES]
    tau = 0.005
    lowest = -tau * np.logaddexp(-ankles[:, 0, 2] / tau, -ankles[:, 1, 2] / tau)
    return ankles[:, :, :2], ANKLE_HEIGHT * subject.shape.calf - lowest


def _load(phases: FloatArray) -> FloatArray:
    """Return the fraction of the weight on the left and the right foot, (M, 2, 1); it shifts in double support."""
    overlap = STANCE - 0.5

    def left(phase: FloatArray) -> FloatArray:
        ramp = np.clip(np.where(phase < 0.5, phase, phase - 0.5) / overlap, 0.0, 1.0)
        eased = ramp * ramp * (3.0 - 2.0 * ramp)
        return np.where(phase < 0.5, eased, 1.0 - eased)

    return np.stack([left(phases % 1.0), left((phases + 0.5) % 1.0)], axis=1)[..., None]


def _low_pass(values: FloatArray, harmonics: int) -> FloatArray:
    """Return periodic values (M, ...), first row = last, truncated to the first `harmonics` harmonics."""
    spectrum = np.fft.rfft(values[:-1], axis=0)
    spectrum[harmonics + 1 :] = 0.0
    smooth = np.fft.irfft(spectrum, len(values) - 1, axis=0)
    return np.concatenate([smooth, smooth[:1]])


def both_sides(published: Mapping[str, GaitCurve]) -> ComplexArray:
    """Return the curves (22, N_HARMONICS + 1) of a `GaitSubject`; the right side is half a cycle after the left."""
    half_cycle = np.where(np.arange(N_HARMONICS + 1) % 2 == 1, -1.0, 1.0)  # factors of the harmonics
    shifts = {True: half_cycle, False: np.ones(N_HARMONICS + 1)}
    return np.stack([_coefficients(published[without_side(n)]) * shifts[n.startswith("right_")] for n in _ANGLE_NAMES])


def _coefficients(curve: GaitCurve) -> ComplexArray:
    """Return the Fourier coefficients, rad, of a gait curve: a truncated monotone periodic spline through its keys."""
    percent, degrees = np.array(curve.keys, dtype=np.float64).T
    periods = np.concatenate([percent - 100.0, percent, percent + 100.0])
    spline = scipy.interpolate.PchipInterpolator(periods, np.tile(np.radians(degrees), 3))
    n = 256
    spectrum = np.fft.rfft(spline(np.arange(n) * 100.0 / n))[: N_HARMONICS + 1] / n
    spectrum[1:] *= 2.0
    return spectrum
