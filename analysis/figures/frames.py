"""Single frames of a recording for figures: bodies and points in space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.recording.read.chunks import Curve, cells, curves, flat, read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.write.scene import ACTIVITY, ESTIMATE, FLEXION, PARTICLES, POINTS, TRUTH
from workbench.results.pictures import lines
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError


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
            estimate=lines(skeletons[ESTIMATE][frame], 3),
            truth=lines(skeletons[TRUTH].get(frame), 3),
            points=flat(points.get(frame)).reshape(-1, 3),
            vertices=flat(vertices.get(frame)).reshape(-1, 3),
            triangles=flat(triangles.get(frame)).reshape(-1, 3).astype(np.int64),
        )
        for frame in frames
    ]


def particles(run: Run, frame: int) -> FloatArray:
    """Return the skeletons of the particles shown in a frame as lines (n, k, 3), m; n may be 0."""
    columns = cells(run.path, [f"/{PARTICLES}"], [frame]).get(PARTICLES, {})
    return lines(columns.get("LineStrips3D:strips", {}).get(frame), 3)


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
