"""A fit to points records the surface, flexions of estimate and truth, and activities."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from recorded import column, record, values
from recording_steps import BODY, steps

from workbench.body.angles import flexions
from workbench.body.kinematics import forward
from workbench.body.surface import attach, person_surface
from workbench.body.surface_mesh import surface_mesh
from workbench.datasets.rendering.visible import surface_points
from workbench.recording.write.scene import SKIN_SPACING_M

N_FRAMES = 3
SURFACE = person_surface(BODY)
MESH, VERTICES = "/world/estimate/surface", "Mesh3D:vertex_positions"


@pytest.fixture(scope="module")
def run():
    """Steps with points of the true surface; the true activity is walking, the estimated one is running in frame 1."""
    run = []
    for k, step in enumerate(steps(N_FRAMES, n_particles=20)):
        truth = step.frame.truth
        points = surface_points(BODY, truth.pose, 100, np.random.default_rng(k))
        frame = replace(step.frame, points=points, views=(), truth=replace(truth, activity="walk"))
        parts = attach(SURFACE, forward(BODY.skeleton, truth.pose[None]), points)
        run.append(replace(step, frame=frame, attachment=parts, activity="run" if k == 1 else "walk"))
    return run


@pytest.fixture(scope="module")
def fit(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("fit") / "run.rrd", run, surface=True)


def test_the_surface_is_the_mesh_of_the_expected_pose(fit, run):
    pytest.importorskip("skimage")
    names = ("vertex_positions", "triangle_indices", "vertex_normals")
    vertices, triangles, normals = (values(fit, MESH, f"Mesh3D:{name}") for name in names)
    assert len(vertices) == N_FRAMES
    for k, step in enumerate(run):
        frames = forward(BODY.skeleton, step.expected_pose[None])
        expected, faces = surface_mesh(SURFACE, frames, SKIN_SPACING_M)
        np.testing.assert_allclose(vertices[k], expected, atol=1e-6)  # float32
        np.testing.assert_array_equal(triangles[k], faces)
        a, b, c = expected[faces].swapaxes(0, 1)
        facing = np.sum(np.cross(b - a, c - a) * np.array(normals[k])[faces[:, 0]], axis=1)
        assert (facing > 0.0).mean() > 0.99  # except in creases, vertex normals point outwards like their triangles


def test_without_scikit_image_the_limbs_are_recorded_with_one_warning(run, tmp_path, monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "skimage", None)
    path = record(tmp_path / "run.rrd", run, surface=True)
    assert not column(path, MESH, VERTICES)
    assert len(column(path, "/world/estimate/body", "Ellipsoids3D:centers")) == N_FRAMES
    warnings = values(path, "/log", "TextLog:text")
    assert sum("scikit-image" in warning for warning in warnings) == caplog.text.count("scikit-image") == 1


def test_flexions_are_recorded_in_degrees_and_activities_as_states(fit, run):
    for name in ("left_hip", "right_hip", "left_knee", "right_knee"):
        poses = {"estimate": [s.expected_pose for s in run], "truth": [s.frame.truth.pose for s in run]}
        for row, series in poses.items():
            expected = [flexions(BODY.skeleton, pose)[name] for pose in series]
            assert values(fit, f"/flexion/{name}/{row}", "Scalars:scalars") == expected
    for row, expected in (("estimate", ["walk", "run", "walk"]), ("truth", ["walk"] * 3)):
        assert values(fit, f"/activity/{row}", "StateChange:state") == expected
