"""Time of the image-motion likelihood: the kernel on one and two threads, and its NumPy reference, side by side.

    python -m analysis.benchmarks.likelihood

Prints milliseconds for 10⁴ particles, 12 limbs, 480×640 px: the minimum over the repeats. The reference runs on
fewer particles and is scaled up. Everything is measured in one process, in turns, so that other load hits all alike.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numba
import numpy as np
from tqdm import tqdm

from analysis.benchmarks.machine import processor, versions
from workbench.arrays import ByteArray, FloatArray
from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.datasets.frame import Frame, View
from workbench.likelihoods import image_motion_reference
from workbench.likelihoods.image_motion import ImageMotion, smoothed
from workbench.likelihoods.image_motion_kernel import PosedView

N_PARTICLES, N_REFERENCE, REPEATS = 10_000, 500, 12
_THREADS = numba.get_num_threads()
CAMERA = plain_camera(640, 480, 620.0, (0.0, -4.0, 1.0), (0.0, 0.0, 0.95))


def main() -> None:
    rng = np.random.default_rng(0)
    before, now = (Frame(i, i / 30.0, (View(CAMERA, _texture(rng)),)) for i in range(2))
    poses_before, poses_now = _poses(rng), _poses(rng)
    print(f"{processor()}, {_THREADS} threads at most; {versions()}")
    print(f"{N_PARTICLES} particles, 12 limbs, 480×640 px; ms, minimum of {REPEATS} repeats\n")
    print("n    kernel, 1 thread   kernel, 2 threads   reference   reference / kernel")
    for n_samples in (50, 100):
        likelihood = ImageMotion(person(from_height(1.75)), n_samples=n_samples)
        everyone, few = (poses_before, poses_now), (poses_before[:N_REFERENCE], poses_now[:N_REFERENCE])
        one, two, reference = _fastest_ms(
            [
                partial(_on_threads, 1, likelihood, before, now, *everyone),
                partial(_on_threads, 2, likelihood, before, now, *everyone),
                partial(_reference, likelihood, before, now, *few),
            ]
        )
        reference *= N_PARTICLES / N_REFERENCE
        print(f"{n_samples:<5}{one:>14.0f}{two:>20.0f}{reference:>14.0f}{reference / one:>16.0f} ×")


def _fastest_ms(timed: Sequence[Callable[[], object]]) -> list[float]:
    """Fastest run of each function, ms; they take turns, after one round that compiles and fills caches."""
    times = np.empty((REPEATS + 1, len(timed)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, function in enumerate(timed):
            start = time.perf_counter()
            function()
            repeat[column] = time.perf_counter() - start
    return [1e3 * float(t) for t in times[1:].min(axis=0)]


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


if __name__ == "__main__":
    main()
