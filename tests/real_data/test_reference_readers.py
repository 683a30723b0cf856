"""Recorded BVH and C3D files are read as by the libraries bvhio and ezc3d."""

import numpy as np
import pytest

from workbench.motion.formats.bvh import read_bvh
from workbench.motion.formats.markers import read_markers

_METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0}


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["dataset-1", "dataset-2"])
def test_joint_positions_agree_with_bvhio(data, folder):
    """They agree to the float32 of bvhio: 2e-6 of the distance from the origin."""
    bvhio = pytest.importorskip("bvhio")
    paths = sorted((data / "bandai" / folder).glob("*.bvh"))[::100]
    if not paths:
        pytest.skip(f"no Bandai recordings in {data}")
    for path in paths:
        clip, root = read_bvh(path), bvhio.readAsHierarchy(str(path))
        for frame in np.linspace(0, len(clip) - 1, 4).astype(int).tolist():
            root.loadPose(frame)
            positions = {joint.Name: np.array(joint.PositionWorld) for joint, _, _ in root.layout()}
            own = 100.0 * clip.positions[frame][:, [1, 2, 0]]  # cm, y up
            shared = [k for k, name in enumerate(clip.joints) if name in positions]
            assert len(shared) > 15
            expected = np.array([positions[clip.joints[k]] for k in shared])
            np.testing.assert_allclose(own[shared], expected, atol=2e-6 * np.abs(expected).max())


def test_marker_distances_agree_with_ezc3d(data):
    """Distances between markers do not depend on the axes; many markers are missing."""
    ezc3d, path = pytest.importorskip("ezc3d"), data / "bmc" / "Gait.c3d"
    if not path.is_file():
        pytest.skip(f"no bmc/Gait.c3d in {data}")
    markers, file = read_markers(path), ezc3d.c3d(str(path))
    point = file["parameters"]["POINT"]
    assert list(markers.names) == [label.strip() for label in point["LABELS"]["value"]]
    points = _METRES[point["UNITS"]["value"][0]] * file["data"]["points"][:3].transpose(2, 1, 0)
    distances, expected = (
        np.linalg.norm(np.diff(positions, axis=1), axis=-1) for positions in (markers.positions, points)
    )
    known = np.isfinite(distances)
    assert known.mean() > 0.3
    np.testing.assert_allclose(distances[known], expected[known], atol=1e-9)
