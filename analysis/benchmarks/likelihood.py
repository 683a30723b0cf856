"""Time of the image-motion likelihood: against its NumPy reference, against bare lookups, and on two threads.

    python -m analysis.benchmarks.likelihood

For 10⁴ particles, 12 limbs, 640×480 px; the reference runs on fewer particles and is scaled up. Everything is measured
in one process, in turns, so that other load hits all alike, and the fastest of the repeats counts. Figures of one
thread are of processor time; that of two threads is by the clock, and so wants a quiet machine.
"""

import platform
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import cv2
import numba
import numpy as np
from tqdm import tqdm

from analysis.benchmarks.lookups import float32_lookups, packed_bytes, packed_lookups, phased_lookups
from workbench.arrays import ByteArray, Float32Array, FloatArray
from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward
from workbench.body.lanes import LANES
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.datasets.frame import Frame, View
from workbench.likelihoods import image_motion_reference
from workbench.likelihoods.image_motion import ImageMotion, smoothed
from workbench.likelihoods.image_motion_kernel import PosedView, packed, place_points

N_PARTICLES, N_REFERENCE, N_PLACED, REPEATS = 10_000, 500, 1600, 12
_THREADS = numba.get_num_threads()
CAMERA = plain_camera(640, 480, 620.0, (0.0, -4.0, 1.0), (0.0, 0.0, 0.95))


def main() -> None:
    print(f"{_processor()}, {_THREADS} threads at most; {_versions()}")
    print(f"{N_PARTICLES} particles, 12 limbs, 640×480 px; minimum of {REPEATS} repeats\n")
    for n_samples in (50, 100):
        print(f"n = {n_samples}")
        for name, value, unit, bar in figures(n_samples):
            print(f"  {name:<28}{value:>8.2f} {unit:<10}{bar}")


def figures(n_samples: int) -> list[tuple[str, float, str, str]]:
    """Name, value, unit and bar of every figure, for n points a limb."""
    rng = np.random.default_rng(0)
    before, now = (Frame(i, i / 30.0, (View(CAMERA, _texture(rng)),)) for i in range(2))
    poses = _poses(rng), _poses(rng)
    few = tuple(p[:N_REFERENCE] for p in poses)
    likelihood = ImageMotion(person(from_height(1.75)), n_samples=n_samples)
    places, lookups = _places(likelihood, poses[1]), 2 * N_PARTICLES * 12 * n_samples
    image = smoothed(now.views[0], likelihood.blur_px)
    words, small_words, width = packed(image), packed_bytes(image), image.shape[1]
    wall, processor = _fastest_ms(
        [
            partial(_on_threads, 1, likelihood, before, now, *poses),
            partial(_on_threads, 2, likelihood, before, now, *poses),
            partial(_reference, likelihood, before, now, *few),
            partial(float32_lookups, image, *places),
            partial(packed_lookups, small_words, *places, 8),
            partial(packed_lookups, words, *places, 16),
            partial(phased_lookups, words.ravel(), width, *places),
        ]
    )
    one, _, reference, float32, plain8, plain16, phased = processor
    reference *= N_PARTICLES / N_REFERENCE
    ns = 1e6 / len(places[0])  # milliseconds of all places to nanoseconds of one
    return [
        ("kernel_ms", one, "ms", ""),
        ("reference_ms", reference, "ms", ""),
        ("kernel_vs_numpy", reference / one, "×", ">= 60, aim 75"),
        ("two_threads", wall[0] / wall[1], "×", ">= 1.7, aim 1.85"),
        ("lookup_float32_ns", float32 * ns, "ns", "<= 3.8"),
        ("lookup_8_bit_ns", plain8 * ns, "ns", "<= 2.4"),
        ("lookup_16_bit_ns", plain16 * ns, "ns", "the kernel's precision"),
        ("lookup_phased_ns", phased * ns, "ns", "the same in the kernel's three phases"),
        ("kernel_vs_lookups", 1e6 * one / lookups / (plain16 * ns), "×", "<= 1.5, aim 1.3; against 16-bit lookups"),
        ("kernel_vs_float32_lookups", 1e6 * one / lookups / (float32 * ns), "×", ""),
        ("kernel_vs_phased_lookups", 1e6 * one / lookups / (phased * ns), "×", ""),
    ]


def _places(likelihood: ImageMotion, poses: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Where the kernel looks in the present image for some particles, px, in its order."""
    body = likelihood.body
    pixels, _, _ = place_points(body.limbs, likelihood.samples, CAMERA, forward(body.skeleton, poses[:N_PLACED]), False)
    pixels = pixels.reshape(-1, LANES, *pixels.shape[1:]).transpose(4, 0, 2, 3, 1)
    x, y = pixels.reshape(2, -1)
    return np.clip(x, 0.0, CAMERA.width - 2.0), np.clip(y, 0.0, CAMERA.height - 2.0)


def _fastest_ms(timed: Sequence[Callable[[], object]]) -> FloatArray:
    """Fastest run of each function, ms by the wall's clock and of this thread's processor time: (2, functions).

    They take turns, after one round that compiles and fills caches.
    """
    times = np.empty((REPEATS + 1, 2, len(timed)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, function in enumerate(timed):
            wall, processor = time.perf_counter(), time.thread_time()
            function()
            repeat[:, column] = time.perf_counter() - wall, time.thread_time() - processor
    fastest: FloatArray = 1e3 * times[1:].min(axis=0)
    return fastest


def _on_threads(
    threads: int, likelihood: ImageMotion, before: Frame, now: Frame, poses_before: FloatArray, poses_now: FloatArray
) -> FloatArray:
    numba.set_num_threads(min(threads, _THREADS))
    return likelihood.log_prob(before, now, poses_before, poses_now)


def _reference(
    likelihood: ImageMotion, before: Frame, now: Frame, poses_before: FloatArray, poses_now: FloatArray
) -> FloatArray:
    body, posed = likelihood.body, []
    for frame, poses in ((before, poses_before), (now, poses_now)):
        view = frame.views[0]
        image = smoothed(view, likelihood.blur_px)
        posed.append(PosedView(view.camera, image, forward(body.skeleton, poses)))
    model, samples = likelihood.model, likelihood.samples
    return image_motion_reference.view_log_prob(body.limbs, samples, model, posed[0], posed[1])[0]


def _poses(rng: np.random.Generator) -> FloatArray:
    """People near the middle of the picture, of every pose: what a tracker's particles look like at their widest."""
    spread = np.concatenate([np.full(3, 0.05), np.full(3, 0.1), np.full(19, 0.25)])
    middle = np.zeros(25)
    middle[2] = 0.95
    return middle + spread * rng.standard_normal((N_PARTICLES, 25))


def _texture(rng: np.random.Generator) -> ByteArray:
    noise = cv2.GaussianBlur(rng.standard_normal((480, 640)), (0, 0), 3.0)
    texture: ByteArray = np.clip(128.0 + 40.0 * noise / noise.std(), 0.0, 255.0).astype(np.uint8)
    return texture


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _versions() -> str:
    return f"Python {platform.python_version()}, NumPy {np.__version__}, numba {numba.__version__}"


if __name__ == "__main__":
    main()
