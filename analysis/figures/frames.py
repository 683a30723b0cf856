"""Single frames of a recording for figures: images with skeletons, bodies and points in space."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]

from workbench.recording.read.chunks import Curve, cells, curves, read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.write.images import OVERLAYS
from workbench.recording.write.scene import ACTIVITY, ESTIMATE, FLEXION, PARTICLES, POINTS, TRUTH
from workbench.utils.arrays import ByteArray, FloatArray, IntArray
from workbench.utils.errors import InputError

_SKELETONS = OVERLAYS[:3]  # the others are points


@dataclass(frozen=True, eq=False)
class Picture:
    """First camera's image in a frame, undistorted, (height, width) grey or (height, width, 3) RGB.

    skeletons: "particles", "estimate", "truth", each as lines (n, k, 2), pixels of the image; n may be 0.
    """

    frame: int
    image: ByteArray
    skeletons: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Scene:
    """A frame in the world, m. estimate, truth: skeletons as lines (n, k, 3). points: observed, (K, 3).

    vertices, triangles: (V, 3) and (T, 3), the surface of the expected pose. Unrecorded parts are empty.
    """

    frame: int
    estimate: FloatArray
    truth: FloatArray
    points: FloatArray
    vertices: FloatArray
    triangles: IntArray


def pictures(run: Run, frames: Sequence[int]) -> list[Picture]:
    """Return the images of these frames; raises InputError where one of them has none."""
    columns = cells(run.path, ["/world/**"], frames)
    cameras = sorted(path for path, components in columns.items() if "EncodedImage:blob" in components)
    if not cameras:
        raise InputError(f"{run.path}: expected images of frames {list(frames)}, found none")
    jpegs = columns[cameras[0]]["EncodedImage:blob"]
    if missing := [frame for frame in frames if frame not in jpegs]:
        raise InputError(f"{run.path}: no image of frame {missing[0]}")
    lines = {name: columns.get(f"{cameras[0]}/{name}", {}).get("LineStrips2D:strips", {}) for name in _SKELETONS}
    return [
        Picture(frame, _decoded(jpegs[frame]), {name: _lines(rows.get(frame), 2) for name, rows in lines.items()})
        for frame in frames
    ]


def scenes(run: Run, frames: Sequence[int]) -> list[Scene]:
    """Return these frames in the world; raises InputError where one was not recorded."""
    columns = cells(run.path, ["/world/**"], frames)
    skeletons = {path: columns.get(f"{path}/skeleton", {}).get("LineStrips3D:strips", {}) for path in (ESTIMATE, TRUTH)}
    if missing := [frame for frame in frames if frame not in skeletons[ESTIMATE]]:
        raise InputError(f"{run.path}: no frame {missing[0]}")
    points = columns.get(POINTS, {}).get("Points3D:positions", {})
    mesh = columns.get(f"{ESTIMATE}/surface", {})
    vertices, triangles = mesh.get("Mesh3D:vertex_positions", {}), mesh.get("Mesh3D:triangle_indices", {})
    return [
        Scene(
            frame=frame,
            estimate=_lines(skeletons[ESTIMATE][frame], 3),
            truth=_lines(skeletons[TRUTH].get(frame), 3),
            points=_flat(points.get(frame)).reshape(-1, 3),
            vertices=_flat(vertices.get(frame)).reshape(-1, 3),
            triangles=_flat(triangles.get(frame)).reshape(-1, 3).astype(np.int64),
        )
        for frame in frames
    ]


def particles(run: Run, frame: int) -> FloatArray:
    """Return the skeletons of the particles shown in a frame as lines (n, k, 3), m; n may be 0."""
    columns = cells(run.path, [f"/{PARTICLES}"], [frame]).get(PARTICLES, {})
    return _lines(columns.get("LineStrips3D:strips", {}).get(frame), 3)


def flexions(run: Run) -> dict[str, dict[str, Curve]]:
    """Return by hip or knee, such as left_hip, then "estimate" and, if available, "truth": degrees over frames.

    Empty for a run that was not fitted to points.
    """
    by_joint: dict[str, dict[str, Curve]] = {}
    for path, curve in curves(read_chunks(run.path, [f"/{FLEXION}/**"])).items():
        _, name, row = path.split("/")
        by_joint.setdefault(name, {})[row] = curve
    return by_joint


def activities(run: Run) -> dict[str, dict[int, str]]:
    """Return the activity in every frame, estimated ("estimate") and true ("truth"), if available."""
    columns = cells(run.path, [f"/{ACTIVITY}/**"])
    by_row = {path.removeprefix(f"{ACTIVITY}/"): rows.get("StateChange:state") for path, rows in columns.items()}
    return {
        row: {frame: str(value.as_py()[0]) for frame, value in states.items()}
        for row, states in by_row.items()
        if states
    }


def _flat(cell: Any) -> FloatArray:
    """Flatten all numbers in a cell of nested lists, (n,); none where there is no cell."""
    if cell is None or not len(cell):
        return np.empty(0)
    values = cell.values
    while pa.types.is_nested(values.type):
        values = values.flatten()
    return np.asarray(values, dtype=np.float64)


def _lines(cell: Any, n_axes: int) -> FloatArray:
    n = 0 if cell is None else len(cell)
    return _flat(cell).reshape(n, -1, n_axes) if n else np.empty((0, 2, n_axes))


def _decoded(cell: Any) -> ByteArray:
    jpeg = _flat(cell).astype(np.uint8)
    image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED), dtype=np.uint8)
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])  # OpenCV decodes to BGR
