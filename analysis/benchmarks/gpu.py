"""The step of several cues on a GPU: appearance, edges and silhouette of up to 10⁶ particles, beside the processor.

    python -m analysis.benchmarks.gpu [N …]

Of every number N of particles: milliseconds on all cores; on the GPU, with images smoothed, filtered and sent, poses
sent and sums fetched; the same of one particle, which is mostly the images; what the GPU takes for one chunk of
particles, times their number; and how far the two's log likelihoods differ: the median and the largest of N, nats,
beside their own standard deviation. A rendered
walk, 640×480 px, 12 limbs, one camera, particles as far apart as a tracker's. The fastest of some runs counts.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numba import cuda

from analysis.benchmarks.machine import cores, processor, versions
from workbench.arrays import FloatArray
from workbench.body.limbs import person
from workbench.core.clip import Clip
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation, Likelihood
from workbench.datasets.synthetic import Synthetic
from workbench.errors import InputError
from workbench.likelihoods.appearance import Appearance
from workbench.likelihoods.edges import Edges
from workbench.likelihoods.gpu.looks import (
    CHUNK,
    check_gpu,
    constants,
    evaluate_on_gpu,
    judge_sent,
    kept_lanes,
    send,
    sights,
)
from workbench.likelihoods.limb_looks import LimbLook, evaluate_together
from workbench.likelihoods.silhouette import Silhouette

SIZES = (2_000, 10_000, 100_000, 1_000_000)
REPEATS, REPEATS_OF_LONG, LONG = 20, 10, 100_000
_SPREAD = np.concatenate([np.full(3, 0.02), np.full(22, 0.06)])  # m and rad


@dataclass(frozen=True, eq=False)
class Scene:
    """The cues of walk_best that know the person, two frames of a rendered walk, and the pose (P,) in the first."""

    cues: Sequence[Likelihood]
    frames: tuple[Frame, Frame]
    start: FloatArray

    def looks(self) -> list[LimbLook]:
        """Looks at the second frame that have computed nothing of it yet."""
        found = [cue.look(*self.frames) for cue in self.cues]
        return [look for look in found if isinstance(look, LimbLook)]

    def poses(self, n: int) -> FloatArray:
        """Particles (n, P)."""
        return self.start + _SPREAD * np.random.default_rng(1).standard_normal((n, len(self.start)))


def walk() -> Scene:
    """A rendered walk; edges are learned."""
    dataset = Synthetic(n_frames=20, path="straight")
    known, (first, second, *_) = dataset.known, dataset.frames()
    assert known.shape is not None
    assert known.start_pose is not None
    body = person(known.shape)
    cues = (Appearance(body), Edges(body), Silhouette(body, Clip(dataset)))
    begun = [cue.look(None, first).remember(known.start_pose) for cue in cues]
    return Scene(begun, (first, second), known.start_pose)


def line(scene: Scene, n: int) -> str:
    """A line of the table."""
    poses, repeats = scene.poses(n), REPEATS_OF_LONG if n > LONG else REPEATS
    cpu, reference = _fastest_ms(scene, poses, evaluate_together, 1 if n > LONG else 3)
    images, _ = _fastest_ms(scene, poses[:1], evaluate_on_gpu, repeats)
    whole, ours = _fastest_ms(scene, poses, evaluate_on_gpu, repeats)
    kernels = n / min(n, CHUNK) * _chunk_ms(scene, poses[:CHUNK])
    apart = np.abs(ours - reference)
    told = "".join(f"{ms:>10.2f}" for ms in (cpu, whole, images, kernels))
    return f"{n:>9}{told}{np.median(apart):>10.1e}{apart.max():>10.1e}{np.std(reference):>8.2f}"


def _fastest_ms(
    scene: Scene, poses: FloatArray, judge: Callable[[list[LimbLook], FloatArray], list[Evaluation]], repeats: int
) -> tuple[float, FloatArray]:
    """The fastest of some evaluations, ms, and the log likelihoods (N,), all cues together."""
    times, log_prob = [], np.zeros(len(poses))
    for _ in range(repeats + 1):  # the first compiles
        looks = scene.looks()
        began = perf_counter()
        found = judge(looks, poses)
        times.append(1e3 * (perf_counter() - began))
        log_prob = np.sum([each.log_prob for each in found], axis=0)
    return min(times[1:]), log_prob


def _chunk_ms(scene: Scene, poses: FloatArray) -> float:
    """What the GPU takes for one chunk, ms."""
    looks = scene.looks()
    body, (sight,) = looks[0].body, sights(looks)
    lane, constant, found = kept_lanes(poses.shape[1], body)[0], constants(body), []
    for _ in range(5):
        begin, end = cuda.event(), cuda.event()
        send(lane, poses)
        begin.record(lane.stream)
        judge_sent(lane, len(poses), constant, sight)
        end.record(lane.stream)
        end.synchronize()
        found.append(cuda.event_elapsed_time(begin, end))
    return float(min(found))


def main(arguments: Sequence[str]) -> int:
    """Exit code 0, 2 where there is no GPU."""
    try:
        check_gpu()
    except InputError as error:
        print(f"gpu: {error}", file=sys.stderr)
        return 2
    name = cuda.get_current_device().name  # bytes in numba's own CUDA target, text in that of numba-cuda
    told = name.decode() if isinstance(name, bytes) else name
    print(f"{told}; {processor()}, {cores()} cores; {versions()}", flush=True)
    scene = walk()
    print("particles       CPU       GPU    images   kernels     apart   largest   sigma", flush=True)
    for n in map(int, arguments) if arguments else SIZES:
        print(line(scene, n), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
