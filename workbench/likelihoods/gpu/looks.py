"""Looks at the limbs, judged together by a GPU: the host's part."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numba import cuda

from workbench.arrays import Float32Array, FloatArray
from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.likelihood import Evaluation
from workbench.errors import InputError
from workbench.likelihoods.appearance import Template, TemplateJudge, heights, places_on_template
from workbench.likelihoods.edges import ResponseJudge
from workbench.likelihoods.edges.filters import POINTS, filtered
from workbench.likelihoods.gpu.cues import APPEARANCE, CUES, EDGES, MOST_LIMBS, PARTICLES, SILHOUETTE, WARP, judge
from workbench.likelihoods.gpu.places import FRAME, LIMB, place_limbs
from workbench.likelihoods.image_motion.kernel import limb_table
from workbench.likelihoods.limb_looks import LimbLook, ViewJudge
from workbench.likelihoods.looks import among_finite, finite_rows
from workbench.likelihoods.silhouette import OutlineJudge
from workbench.threads import over_threads

CHUNK = 1 << 16
"""Particles under way together; while they are judged, the next are sent."""
_BLOCK, _ROWS = 128, 4096  # threads of a block that place limbs; poses at least that one thread copies
_NONE = {n: np.zeros((1,) * n, np.float32) for n in range(1, 5)}  # instead of what no cue looks at, by dimensions
_KINDS = {APPEARANCE: TemplateJudge, EDGES: ResponseJudge, SILHOUETTE: OutlineJudge}


@dataclass(frozen=True, eq=False)
class Lane:
    """Memory, here and on the GPU, of one chunk of particles, and the stream in which it is worked on."""

    stream: Any
    sent: Float32Array  # (CHUNK, P), pinned
    found: Float32Array  # (CUES, CHUNK), pinned
    which_finite: Any  # (CHUNK,), pinned
    poses: Any
    finite: Any
    frames: Any
    limbs: Any
    sums: Any


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera's cues look at, on the GPU. which: the look and the cue of each of its judges, and by what the
    cue's sum is multiplied."""

    camera: Any
    rim_px: np.float32
    seen: tuple[Any, ...]
    which: Sequence[tuple[int, int, float]]


def check_gpu() -> None:
    """Raise InputError where there is no GPU to compute on."""
    if not cuda.is_available():
        needs = "an NVIDIA GPU, its driver and the extra `gpu` (pip install -e '.[gpu]')"
        raise InputError(f"likelihood: device=gpu needs {needs}; numba finds none")


def evaluate_on_gpu(looks: Sequence[LimbLook], pose: FloatArray) -> list[Evaluation]:
    """What `limb_looks.evaluate_together` finds of poses (N, P), in float32: points that lie within rounding of the
    image's rim, another limb's or a histogram bin's fall on either side. The same GPU gives the same bits.

    Raises InputError where a look is none of appearance, edges and silhouette, and for bodies of over MOST_LIMBS limbs.
    """
    body = looks[0].body
    if len(body.limbs) > MOST_LIMBS:
        raise InputError(f"likelihood: on a GPU bodies may have {MOST_LIMBS} limbs, this one has {len(body.limbs)}")
    views, constant = sights(looks), constants(body)
    log_prob = np.zeros((len(looks), len(pose)))
    finite = np.ones(len(pose), dtype=np.bool_) if views else finite_rows(pose)
    lanes = kept_lanes(pose.shape[1], body)
    chunks = [(first, min(first + CHUNK, len(pose))) for first in range(0, len(pose), CHUNK)]
    for sight in views:
        for k in range(len(chunks) + len(lanes)):
            lane = lanes[k % len(lanes)]
            if k >= len(lanes):
                lane.stream.synchronize()
                first, last = chunks[k - len(lanes)]
                finite[first:last] = lane.which_finite[: last - first]
                for look, cue, scale in sight.which:
                    log_prob[look, first:last] += scale * lane.found[cue, : last - first]
            if k < len(chunks):
                first, last = chunks[k]
                send(lane, pose[first:last])
                judge_sent(lane, last - first, constant, sight)
                lane.sums.copy_to_host(lane.found, stream=lane.stream)
                lane.finite.copy_to_host(lane.which_finite, stream=lane.stream)
    found = log_prob if finite.all() else log_prob[:, finite]
    return [among_finite(look.name, finite, each) for look, each in zip(looks, found, strict=True)]


def send(lane: Lane, poses: FloatArray) -> None:
    """Send poses (N, P), N at most CHUNK, as float32."""

    def stage(first: int, last: int) -> None:
        lane.sent[first:last] = poses[first:last]

    over_threads(stage, len(poses), _ROWS)
    lane.poses[: len(poses)].copy_to_device(lane.sent[: len(poses)], stream=lane.stream)


def judge_sent(lane: Lane, n: int, constant: tuple[Any, ...], sight: Sight) -> None:
    """Have the first n poses sent judged."""
    blocks, table = (n + _BLOCK - 1) // _BLOCK, constant[4]
    place_limbs[blocks, _BLOCK, lane.stream](
        np.int32(n), lane.poses, lane.finite, *constant, sight.camera, sight.rim_px, lane.frames, lane.limbs
    )
    blocks, shared = (n + PARTICLES - 1) // PARTICLES, 4 * PARTICLES * table.shape[0] * LIMB
    rows = lane.limbs.reshape(-1, CHUNK)
    judge[blocks, (WARP, PARTICLES), lane.stream, shared](np.int32(n), rows, table, *sight.seen, lane.sums)


@lru_cache(maxsize=1)
def kept_lanes(n_dofs: int, body: Body) -> tuple[Lane, ...]:
    """Two of them, for poses of so many numbers."""
    n_joints, n_limbs = len(body.skeleton.names), len(body.limbs)
    return tuple(
        Lane(
            cuda.stream(),
            cuda.pinned_array((CHUNK, n_dofs), np.float32),
            cuda.pinned_array((CUES, CHUNK), np.float32),
            cuda.pinned_array(CHUNK, np.int8),
            cuda.device_array((CHUNK, n_dofs), np.float32),
            cuda.device_array(CHUNK, np.int8),
            cuda.device_array((n_joints, FRAME, CHUNK), np.float32),
            cuda.device_array((n_limbs, LIMB, CHUNK), np.float32),
            cuda.device_array((CUES, CHUNK), np.float32),
        )
        for _ in range(2)
    )


@lru_cache(maxsize=4)
def constants(body: Body) -> tuple[Any, ...]:
    """The skeleton, the limbs' table and their joints."""
    skeleton = body.skeleton
    return (
        *(_sent(skeleton.parents, np.int32), _sent(skeleton.offsets), _sent(skeleton.dof_joints, np.int32)),
        *(_sent(skeleton.dof_axes), _sent(limb_table(body.limbs)), _sent(body.limbs.joints, np.int32)),
    )


def sights(looks: Sequence[LimbLook]) -> list[Sight]:
    """The cameras that look; of each, what its cues look at. Two cues of a kind make two sights of one camera."""
    found: list[tuple[Camera, dict[int, tuple[int, ViewJudge]]]] = []
    for i, look in enumerate(looks):
        for each in look.judges:
            cue = _kind(look.name, each)
            free = (cues for camera, cues in found if camera is each.camera and cue not in cues)
            cues = next(free, None)
            if cues is None:
                cues = {}
                found.append((each.camera, cues))
            cues[cue] = i, each
    return [_sight(camera, cues) for camera, cues in found]


def _kind(name: str, judge: ViewJudge) -> int:
    for cue, kind in _KINDS.items():
        if isinstance(judge.judge, kind):
            return cue
    raise InputError(f"likelihood: device=gpu judges by appearance, edges and silhouette alone, found {name}; give it the weight 0")


def _sight(camera: Camera, cues: dict[int, tuple[int, ViewJudge]]) -> Sight:
    judges = {cue: each.judge for cue, (_, each) in cues.items()}
    points, along, image, template, epsilon = _NONE[2], _NONE[1], _NONE[2], _NONE[4], 1.0
    responses, gradient, ridges, reached, rim_px = _NONE[3], _NONE[3], _NONE[4], _NONE[2], 0.0
    asked, scales = sum(1 << cue for cue in cues), {}
    if (seen := judges.get(APPEARANCE)) is not None:
        along, offsets = places_on_template(seen.samples)
        points, image, epsilon = np.column_stack([seen.samples, offsets]), seen.image, seen.epsilon
        template = template_cells(seen.template, seen.sigma, seen.epsilon)
        scales[APPEARANCE] = seen.k / len(seen.samples)
    if (seen := judges.get(EDGES)) is not None:
        images = filtered(seen.view.about((0, 0, camera.width, camera.height)), (0, 0, camera.width, camera.height))
        responses, gradient, ridges = seen.table, images.gradient, images.ridges
        scales[EDGES] = seen.k / len(POINTS)
    if (seen := judges.get(SILHOUETTE)) is not None:
        reached, rim_px, scales[SILHOUETTE] = seen.reached, seen.rim_px, seen.scale
    size = _sent(np.array([camera.width, camera.height]))
    sent = (
        *(np.int32(asked), size, _sent(points), _sent(along, np.int32), _sent(image), _sent(template), np.float32(epsilon)),
        *(_sent(responses), _sent(gradient), _sent(ridges), _sent(reached)),
    )
    which = [(look, cue, scales[cue]) for cue, (look, _) in cues.items()]
    return Sight(_sent(camera.row), np.float32(rim_px), sent, which)


def template_cells(template: Template, sigma: float, epsilon: float) -> Float32Array:
    """Mean, height and slope of every cell, (L, ALONG, AROUND, 3); see `appearance.heights`."""
    return np.stack([template.mean, *heights(template, sigma, epsilon)], axis=-1, dtype=np.float32)


def _sent(array: Any, dtype: Any = np.float32) -> Any:
    return cuda.to_device(np.ascontiguousarray(array, dtype=dtype))
