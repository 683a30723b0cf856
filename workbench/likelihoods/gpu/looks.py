"""Looks at the limbs, judged together by a GPU: the host's part."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numba import cuda

from workbench.arrays import AnyArray, Float32Array, FloatArray
from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.likelihood import Evaluation, Look
from workbench.errors import InputError
from workbench.likelihoods.appearance import Template, TemplateJudge, heights, places_on_template
from workbench.likelihoods.edges import ResponseJudge
from workbench.likelihoods.edges.filters import POINTS
from workbench.likelihoods.gpu.cues import APPEARANCE, CUES, EDGES, MOST_LIMBS, PARTICLES, SILHOUETTE, WARP, judge
from workbench.likelihoods.gpu.images import filtered_on_gpu
from workbench.likelihoods.gpu.places import FRAME, LIMB, place_limbs
from workbench.likelihoods.image_motion.kernel import limb_table
from workbench.likelihoods.limb_looks import LimbLook, ViewJudge
from workbench.likelihoods.looks import among_finite, finite_rows
from workbench.likelihoods.silhouette import OutlineJudge
from workbench.threads import over_threads

warnings.filterwarnings("ignore", message=r".*Grid size .* under-utilization")  # of small images and few particles

CHUNK = 1 << 16
"""Particles under way together; while they are judged, the next are sent."""
_BLOCK, _ROWS = 128, 4096  # threads of a block that place limbs; poses at least that one thread copies
_NOTHING = np.zeros(1, np.float32)  # instead of what no cue looks at
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


@cache
def check_gpu() -> None:
    """Raise InputError where there is no GPU to compute on."""
    if not cuda.is_available():
        needs = "an NVIDIA GPU, its driver and the extra `gpu` (pip install -e '.[gpu]')"
        raise InputError(f"likelihood: device=gpu needs {needs}; numba finds none")


def check_looks(looks: Mapping[str, Look]) -> None:
    """Raise InputError where a look, by its name, is none that is judged here."""
    kinds = tuple(_KINDS.values())
    for name, look in looks.items():
        if not isinstance(look, LimbLook) or not all(isinstance(each.judge, kinds) for each in look.judges):
            advice = f"found {name}; give it the weight 0"
            raise InputError(f"likelihood: device=gpu judges by appearance, edges and silhouette alone, {advice}")


def evaluate_on_gpu(looks: Sequence[LimbLook], pose: FloatArray) -> list[Evaluation]:
    """What `limb_looks.evaluate_together` finds of poses (N, P), in float32: points that lie within rounding of the
    image's rim, another limb's or a histogram bin's fall on either side. The same GPU gives the same bits.

    looks: of one body, as `check_looks` allows. Raises InputError for bodies of over MOST_LIMBS limbs.
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
    blocks, n_limbs = (n + PARTICLES - 1) // PARTICLES, table.shape[0]
    judge[blocks, (WARP, PARTICLES), lane.stream, 4 * PARTICLES * n_limbs * LIMB](
        np.int32(n), lane.limbs.reshape(-1, CHUNK), np.int32(n_limbs), table.ravel(), *sight.seen, lane.sums
    )


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
    arrays = skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes
    types = np.int32, np.float32, np.int32, np.float32, np.float32, np.int32
    every = zip((*arrays, limb_table(body.limbs), body.limbs.joints), types, strict=True)
    return tuple(cuda.to_device(np.ascontiguousarray(array, dtype=dtype)) for array, dtype in every)


def sights(looks: Sequence[LimbLook]) -> list[Sight]:
    """The cameras that look; of each, what its cues look at. Two cues of a kind make two sights of one camera."""
    found: list[tuple[Camera, dict[int, tuple[int, ViewJudge]]]] = []
    for i, look in enumerate(looks):
        for each in look.judges:
            cue = next(cue for cue, kind in _KINDS.items() if isinstance(each.judge, kind))
            free = (cues for camera, cues in found if camera is each.camera and cue not in cues)
            cues = next(free, None)
            if cues is None:
                cues = {}
                found.append((each.camera, cues))
            cues[cue] = i, each
    return [_sight(camera, cues) for camera, cues in found]


def _sight(camera: Camera, cues: dict[int, tuple[int, ViewJudge]]) -> Sight:
    judges, scales = {cue: each.judge for cue, (_, each) in cues.items()}, {}
    points: AnyArray = _NOTHING
    template, responses, image, reached = points, points, points, points
    filtered = _sent(_NOTHING), _sent(_NOTHING)
    epsilon, rim_px = 1.0, 0.0
    if isinstance(seen := judges.get(APPEARANCE), TemplateJudge):
        along, offsets = places_on_template(seen.samples)
        points, image, epsilon = np.column_stack([seen.samples, offsets, along]), seen.image, seen.epsilon
        template = template_cells(seen.template, seen.sigma, seen.epsilon)
        scales[APPEARANCE] = seen.k / len(seen.samples)
    if isinstance(seen := judges.get(EDGES), ResponseJudge):
        responses, filtered = seen.table, filtered_on_gpu(seen.view.grey)
        scales[EDGES] = seen.k / len(POINTS)
    if isinstance(seen := judges.get(SILHOUETTE), OutlineJudge):
        reached, rim_px, scales[SILHOUETTE] = seen.reached, seen.rim_px, seen.scale
    row, points_sent, *tables = _sent_together(camera.row, points, template, responses)
    numbers = sum(1 << cue for cue in cues), camera.width, camera.height, len(points)
    seen_by = (
        *(*map(np.int32, numbers), points_sent, _sent(image), tables[0], np.float32(epsilon), tables[1]),
        *(*filtered, _sent(reached)),
    )
    which = [(look, cue, scales[cue]) for cue, (look, _) in cues.items()]
    return Sight(row, np.float32(rim_px), seen_by, which)


def template_cells(template: Template, sigma: float, epsilon: float) -> Float32Array:
    """Mean, height and slope of every cell, (L, ALONG, AROUND, 3); see `appearance.heights`."""
    return np.stack([template.mean, *heights(template, sigma, epsilon)], axis=-1, dtype=np.float32)


def _sent(array: Any) -> Any:
    """Send an array, as float32 in one piece."""
    return cuda.to_device(np.ascontiguousarray(array, dtype=np.float32).ravel())


def _sent_together(*arrays: AnyArray) -> list[Any]:
    """Send small arrays at once: each sending takes a tenth of a millisecond."""
    sent, ends = _sent(np.concatenate([array.ravel() for array in arrays])), np.cumsum([array.size for array in arrays])
    return [sent[end - array.size : end] for end, array in zip(ends, arrays, strict=True)]
