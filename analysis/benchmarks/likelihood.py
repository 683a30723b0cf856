"""Time of the image-motion likelihood: against the NumPy oracle, against bare lookups, and on two threads.

For 10⁴ particles, 12 limbs, n = 50, 640×480 px; the oracle runs on fewer particles and is scaled up. Everything is
measured in one process, in turns, so that other load hits all alike, and the fastest of the repeats counts. Figures of
one thread are of processor time; that of two threads is by the clock, and so wants a quiet machine.
"""

import time
from functools import partial
from typing import Any

import cv2
import numba
import numpy as np

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.measuring import fastest_s
from tests.oracles import image_motion as oracle
from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.simd_kinematics import FAST, LANES
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.core.likelihood import FrameLikelihood
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.cues.limb_points import limb_points
from workbench.likelihoods.image_motion import BLUR_PX, ImageMotion
from workbench.likelihoods.image_motion.kernel import packed
from workbench.utils.arrays import ByteArray, Float32Array, FloatArray

N_PARTICLES, N_SAMPLES, N_REFERENCE, N_PLACED = 10_000, 50, 500, 1600
CAMERA = plain_camera(640, 480, 620.0, (0.0, -4.0, 1.0), (0.0, 0.0, 0.95))


def kernel_figures() -> list[Figure]:
    """Measure one thread against the oracle, and against the lookups that no likelihood of images can do without."""
    rng = np.random.default_rng(0)
    likelihood, before, now = scene(rng, N_SAMPLES)
    poses = people(rng, N_PARTICLES), people(rng, N_PARTICLES)
    few = poses[0][:N_REFERENCE], poses[1][:N_REFERENCE]
    places, words = _places(likelihood, poses[1]), packed(grey_levels(now.views[0], BLUR_PX))
    one, reference, lookup_s = fastest_s(
        [
            partial(on_threads, 1, likelihood.prepare(before, now), *poses),
            partial(_by_oracle, likelihood, before, now, *few),
            partial(packed_lookups, words, *places),
        ],
        clock=time.thread_time,
    )
    reference *= N_PARTICLES / N_REFERENCE
    lookups = 2 * N_PARTICLES * len(likelihood.body.limbs) * N_SAMPLES
    bare = lookup_s / len(places[0]) * lookups
    return [
        Figure(
            "kernel_vs_numpy", reference / one, "× faster", 60.0, "higher",
            f"NumPy float64: {1e3 * reference:.0f} ms; the kernel: {1e3 * one:.1f} ms",
        ),
        Figure(
            "kernel_vs_lookups", one / bare, "× its time", 1.5, "lower",
            f"{lookups} bare lookups of the same 16 bits: {1e3 * bare:.1f} ms",
        ),
    ]  # fmt: skip


def thread_figures() -> list[Figure]:
    """Measure two threads against one."""
    rng = np.random.default_rng(0)
    likelihood, before, now = scene(rng, N_SAMPLES)
    poses = people(rng, N_PARTICLES), people(rng, N_PARTICLES)
    one, two = fastest_s([partial(on_threads, n, likelihood.prepare(before, now), *poses) for n in (1, 2)], repeats=30)
    what = f"the likelihood of {N_PARTICLES} particles: {1e3 * one:.1f} ms on one, {1e3 * two:.1f} ms on two"
    return [Figure("two_threads", one / two, "× faster", 1.7, "higher", what)]


def scene(rng: np.random.Generator, n_samples: int, scale: float = 1.0) -> tuple[ImageMotion, Frame, Frame]:
    """Return a likelihood and two frames of texture, of 640×480 px times `scale`."""
    camera = CAMERA.scaled(scale)
    before, now = (Frame(i, i / 30.0, (View(camera, _texture(rng, camera.height, camera.width)),)) for i in range(2))
    return ImageMotion(person(from_height(1.75)), n_samples=n_samples), before, now


def people(rng: np.random.Generator, n: int) -> FloatArray:
    """Return poses (n, P) near the middle of the picture, of every kind: a tracker's particles at their widest."""
    spread = np.concatenate([np.full(3, 0.05), np.full(3, 0.1), np.full(19, 0.25)])
    middle = np.zeros(25)
    middle[2] = 0.95
    return middle + spread * rng.standard_normal((n, 25))


def on_threads(
    threads: int, frame_likelihood: FrameLikelihood, poses_before: FloatArray, poses_now: FloatArray
) -> FloatArray:
    """Return the log likelihoods on a number of threads; numba is set back to what it was."""
    previous = numba.get_num_threads()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    try:
        return frame_likelihood.evaluate(poses_before, poses_now).log_prob
    finally:
        numba.set_num_threads(previous)


def _places(likelihood: ImageMotion, poses: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Return the places, px, at which the kernel looks up the present image for some particles, in its order."""
    body = likelihood.body
    pixels = limb_points(body, likelihood.samples, CAMERA, forward(body.skeleton, poses[:N_PLACED])).pixels
    pixels = pixels.reshape(-1, LANES, *pixels.shape[1:]).transpose(4, 0, 2, 3, 1)
    x, y = pixels.reshape(2, -1)
    return np.clip(x, 0.0, CAMERA.width - 2.0), np.clip(y, 0.0, CAMERA.height - 2.0)


def _by_oracle(
    likelihood: ImageMotion, before: Frame, now: Frame, poses_before: FloatArray, poses_now: FloatArray
) -> FloatArray:
    body, posed = likelihood.body, []
    for frame, poses in ((before, poses_before), (now, poses_now)):
        view = frame.views[0]
        image = grey_levels(view, BLUR_PX)
        posed.append(oracle.PosedView(view.camera, image, forward(body.skeleton, poses)))
    model, samples = likelihood.model, likelihood.samples
    return oracle.view_log_prob(body.limbs, samples, model, posed[0], posed[1])[0]


def _texture(rng: np.random.Generator, height: int, width: int) -> ByteArray:
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), 3.0)
    texture: ByteArray = np.clip(128.0 + 40.0 * noise / noise.std(), 0.0, 255.0).astype(np.uint8)
    return texture


@numba.njit(nogil=True, error_model="numpy", fastmath=FAST)
def packed_lookups(words: Any, x: Any, y: Any) -> float:
    """Return the sum of bilinear levels at M places, px: one load a place of four 16-bit levels, `packed` in words."""
    total, mask = 0.0, np.uint64((1 << 16) - 1)
    shift = np.uint64(16)
    for i in range(x.shape[0]):
        column, row = np.uint32(x[i]), np.uint32(y[i])
        fx, fy = x[i] - np.float32(column), y[i] - np.float32(row)
        word = np.uint64(words[row, column])
        a, b = np.float32(np.int32(word & mask)), np.float32(np.int32((word >> shift) & mask))
        word = word >> (shift + shift)
        c, d = np.float32(np.int32(word & mask)), np.float32(np.int32((word >> shift) & mask))
        top, bottom = a + fx * (b - a), c + fx * (d - c)
        total += top + fy * (bottom - top)
    return total
