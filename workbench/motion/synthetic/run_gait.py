"""Synthetic runners from published curves of running, generated as the walkers of `gait`.

Sources, one cycle from foot strike to foot strike of the same foot, at about 3 m/s:
- hip and knee in the sagittal plane, hip and pelvis in the others, toe-off: Novacheck, *Gait & Posture* 7, 1998;
- the elbow, near a right angle: Yegian, Tucker, Gillinov & Lieberman, *J. Exp. Biol.* 222, 2019;
- stride rate: Cavanagh & Kram, *Med. Sci. Sports Exerc.* 21, 1989;
- ground reaction force, half a sine during stance: Robilliard & Wilson, *J. Exp. Biol.* 208, 2005.

The key values are extremes and intermediate values of the published curves to about 5°, not tables. The ranges of the
shoulder, head and joint twists are our choice. As for the walkers, the published hip flexion, relative to a pelvis
tilted forwards by about 17°, is reduced by 10°, since this rigid torso leans by 7° and carries the shoulders too. The
root moves forward uniformly, at the speed of the stance ankle in the body's frame plus its roll over the toes, and
vertically as the force determines. An ankle is lowest, at its height over the sole, at mid-stance.
"""

from dataclasses import replace

import numpy as np
import scipy

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.motion.pose_sequence import Motion
from workbench.motion.synthetic import gait
from workbench.motion.synthetic.gait import ANKLE_HEIGHT, GaitCurve, GaitSubject, both_sides, variation
from workbench.utils.arrays import FloatArray

STANCE = 0.37  # duty factor of a foot; there are two flight phases of 0.13 cycles
GRAVITY = 9.81
FOOT_ROLL = 0.23
"""Forward motion of an ankle during stance, as the foot rolls over the toes, as a fraction of the calf: about 10 cm."""

# A name without a side applies to both: the right side is half a cycle after the left.
RUNNING_CURVES = {
    "root_heading": GaitCurve(((0, -2), (50, 2)), 0.4, 0.0),
    "root_pitch": GaitCurve(((0, 6), (13, 8.5), (37, 6), (50, 6), (63, 8.5), (87, 6)), 0.4, 3.0),
    "root_roll": GaitCurve(((0, 0.5), (15, 2.5), (37, 0), (50, -0.5), (65, -2.5), (87, 0)), 0.4, 0.0),
    "neck_turn": GaitCurve(((0, 2), (50, -2)), 0.4, 0.0),  # the head faces along the path
    "neck_nod": GaitCurve(((0, -5), (50, -5)), 0.4, 4.0),
    "neck_tilt": GaitCurve(((0, -0.5), (15, -2), (50, 0.5), (65, 2)), 0.4, 0.0),
    "shoulder_abduction": GaitCurve(((0, 20), (50, 14)), 0.3, 4.0),
    "shoulder_flexion": GaitCurve(((42, 12), (92, -44)), 0.3, 5.0),  # in antiphase to the thigh of its side
    "shoulder_twist": GaitCurve(((0, 12), (50, 16)), 0.4, 8.0),
    "elbow_flexion": GaitCurve(((46, 104), (96, 86)), 0.4, 8.0),
    "hip_flexion": GaitCurve(
        ((0, 35), (7, 31), (15, 24), (25, 6), (34, -10), (40, -14), (47, -9), (60, 15), (70, 34), (79, 44), (86, 45),
         (95, 39)), 0.10, 3.0,
    ),
    "hip_abduction": GaitCurve(((0, -3), (14, -8), (25, -6), (38, 0), (50, 2), (65, 4), (80, 1), (92, -2)), 0.3, 1.5),
    "hip_twist": GaitCurve(((0, 2), (50, -2)), 0.4, 3.0),
    "knee_flexion": GaitCurve(
        ((0, 17), (8, 35), (15, 43), (22, 39), (30, 28), (37, 21), (43, 28), (52, 58), (60, 82), (67, 92), (75, 83),
         (85, 47), (92, 21), (96, 14)), 0.09, 3.0,
    ),
}  # fmt: skip


def average_runner() -> GaitSubject:
    """Return the published curves on a person of 1.75 m, at 84 strides per minute."""
    return GaitSubject("average", from_height(1.75), stride_hz=1.4, phase=0.0, curves=both_sides(RUNNING_CURVES))


def runners(n: int, rng: np.random.Generator) -> list[GaitSubject]:
    """Return `n` people with the variation of the walkers of `gait.subjects`."""
    average = average_runner()
    return [variation(replace(average, name=f"runner_{i:02d}"), RUNNING_CURVES, rng) for i in range(n)]


def runner(subject: GaitSubject, duration_s: float, rate_hz: float) -> Motion:
    """Return a straight run of `subject` over the ground z = 0, from above the origin towards +x.

    Raises InputError for fewer than two frames, or a rate that is not positive.
    """
    times = gait.frame_times("runner", duration_s, rate_hz)
    phases = subject.phase + subject.stride_hz * times
    stride, height = _stride_and_height(subject)
    positions = np.zeros((len(times), 3))
    positions[:, 0] = stride * subject.stride_hz * times
    positions[:, 2] = height + bounce(phases, subject.stride_hz)
    poses = np.column_stack([positions, subject.angles(phases)])
    return gait.generated(subject, "straight", "run", rate_hz, poses, source=__name__)


def builtin_runs(n_subjects: int = 12, seed: int = 2001) -> tuple[Motion, ...]:
    """Return a small training library: `n_subjects` straight runs of 4 s (about five cycles) at 60 Hz."""
    return tuple(runner(subject, 4.0, 60.0) for subject in runners(n_subjects, np.random.default_rng(seed)))


def bounce(phases: FloatArray, stride_hz: float) -> FloatArray:
    """Return the height of a running body relative to its mean, m, at phases (F,) in cycles.

    In stance, the ground reaction force is half a sine (Robilliard & Wilson 2005) whose mean over a step is the body
    weight; in flight it is zero. The Fourier series of the acceleration is integrated twice.
    """
    n = 256
    step = np.arange(n) * 0.5 / n
    force = np.where(step < STANCE, 0.25 * np.pi / STANCE * np.sin(np.pi * step / STANCE), 0.0)  # in body weights
    spectrum = np.fft.rfft(GRAVITY * force)
    spectrum[0] = 0.0
    omega = 2.0 * np.pi * 2.0 * stride_hz * np.arange(1, len(spectrum))
    spectrum[1:] /= -(omega**2)
    heights = np.fft.irfft(spectrum, n)
    spline = scipy.interpolate.CubicSpline(
        np.linspace(0.0, 0.5, n + 1), np.append(heights, heights[0]), bc_type="periodic"
    )
    return np.asarray(spline(phases % 0.5))


def _stride_and_height(subject: GaitSubject) -> tuple[float, float]:
    """Return the root's displacement per cycle, m, and its mean height over the ground, m, from the left foot's
    stance."""
    phases = STANCE * np.linspace(0.0, 1.0, 65)
    poses = np.zeros((len(phases), len(POSE_NAMES)))
    poses[:, 2] = bounce(phases, subject.stride_hz)
    poses[:, 3:] = subject.angles(phases)
    skeleton = person_skeleton(subject.shape)
    ankle = joints(skeleton, poses)[:, skeleton.joint("left_ankle")]
    stride = (ankle[0, 0] - ankle[-1, 0] + FOOT_ROLL * subject.shape.calf) / STANCE
    return float(stride), ANKLE_HEIGHT * subject.shape.calf - float(ankle[:, 2].min())
