"""What a fit to points leaves in its recording: the surface, flexion against the truth, the activity, a layout."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from recording_steps import BODY, SPACE, steps
from rerun.chunk import RrdReader

from workbench.body.angles import flexions
from workbench.body.kinematics import forward
from workbench.body.surface import attach, person_surface
from workbench.body.surface_mesh import surface_mesh
from workbench.datasets.rendering.visible import surface_points
from workbench.recording.write import layout
from workbench.recording.write.recorder import Recorder
from workbench.recording.write.scene import ACTIVITY, FLEXION, SKIN_SPACING_M

N_FRAMES = 3
SURFACE = person_surface(BODY)


@pytest.fixture(scope="module")
def run():
    """Steps whose frames hold points of the true surface; the person walks and is told to, but for one frame."""
    found = []
    for k, step in enumerate(steps(N_FRAMES, n_particles=20)):
        truth = step.frame.truth
        points = surface_points(BODY, truth.pose, 100, np.random.default_rng(k))
        frame = replace(step.frame, points=points, views=(), truth=replace(truth, activity="walk"))
        parts = attach(SURFACE, forward(BODY.skeleton, truth.pose[None]), points)
        found.append(replace(step, frame=frame, attachment=parts, activity="run" if k == 1 else "walk"))
    return found


def record(path, run, **options):
    with Recorder(path, BODY, SPACE, run_id="fit", config_yaml="", provenance={}, **options) as recorder:
        for step in run:
            recorder.log(step, {"error_abs_mm": 1.0, "error_abs_mm_map": 1.0, "knee_deg": 2.0})
    return path


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("fit") / "run.rrd", run, surface=True)


def values(path, entity, component):
    """A temporal component's value in each frame, in order."""
    found = {}
    for chunk in RrdReader(path).stream().filter(content=entity, is_static=False):
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            found.update(zip(batch.column("frame").to_pylist(), batch.column(component).to_pylist(), strict=True))
    return [found[frame] for frame in sorted(found)]


def test_the_surface_is_the_mesh_of_the_expected_pose(recorded, run):
    pytest.importorskip("skimage")
    vertices, triangles, normals = (
        values(recorded, "/world/estimate/surface", f"Mesh3D:{name}")
        for name in ("vertex_positions", "triangle_indices", "vertex_normals")
    )
    assert len(vertices) == N_FRAMES
    for k, step in enumerate(run):
        frames = forward(BODY.skeleton, step.expected_pose[None])
        expected, faces = surface_mesh(SURFACE, frames, SKIN_SPACING_M)
        np.testing.assert_allclose(vertices[k], expected, atol=1e-6)  # float32
        np.testing.assert_array_equal(triangles[k], faces)
        a, b, c = expected[faces].swapaxes(0, 1)
        facing = np.sum(np.cross(b - a, c - a) * np.array(normals[k])[faces[:, 0]], axis=1)
        assert (facing > 0.0).mean() > 0.99  # but in creases, a vertex looks where its triangles do: outwards


def test_without_scikit_image_a_sentence_says_so_and_the_limbs_stay(run, tmp_path, monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "skimage", None)
    path = record(tmp_path / "run.rrd", run, surface=True)
    assert values(path, "/world/estimate/surface", "Mesh3D:vertex_positions") == []
    assert len(values(path, "/world/estimate/body", "Ellipsoids3D:centers")) == N_FRAMES
    told = [text for (text,) in values(path, "/log", "TextLog:text")]
    assert sum("scikit-image" in sentence for sentence in told) == caplog.text.count("scikit-image") == 1


def test_no_mesh_is_recorded_unasked(run, tmp_path):
    path = record(tmp_path / "run.rrd", run[:1])
    assert values(path, "/world/estimate/surface", "Mesh3D:vertex_positions") == []


def test_flexions_are_recorded_in_degrees_against_the_truth(recorded, run):
    for name in ("left_hip", "right_hip", "left_knee", "right_knee"):
        for row, poses in (
            ("estimate", [step.expected_pose for step in run]),
            ("truth", [step.frame.truth.pose for step in run]),
        ):
            found = [value for (value,) in values(recorded, f"/flexion/{name}/{row}", "Scalars:scalars")]
            assert found == [flexions(BODY.skeleton, pose)[name] for pose in poses]


def test_the_activity_told_and_the_true_one_are_lanes(recorded):
    for row, expected in (("estimate", ["walk", "run", "walk"]), ("truth", ["walk"] * 3)):
        assert [state for (state,) in values(recorded, f"/activity/{row}", "StateChange:state")] == expected


SHOWN = layout.LayoutInput(
    cameras=(), person=np.zeros(3), towards=np.array([2.0, 0.0]), parameters=("root_x",), units=("m",),
    pictured=("root_x",), metrics=("error_abs_mm", "error_abs_mm_map", "ess"), n_coefficients=0, n_particles=20,
    flexions=("left_knee", "left_hip"), activity=True, surface=True,
    drawn=frozenset({"truth", "particles"}),
)  # fmt: skip

WORLD = "world: estimate orange, truth blue, particles purple"


def views(part):
    """All views of a layout."""
    inner = getattr(part, "contents", None)
    if isinstance(inner, list | tuple) and not hasattr(part, "origin"):
        return [view for child in inner for view in views(child)]
    return [part]


def test_a_fit_is_laid_out_for_its_judgement():
    found = {view.name: view for view in views(layout.layout(SHOWN).root_container)}
    names = list(found)
    errors = "distance from the true joints (mm)"
    assert names.index("left hip flexion (degrees)") < names.index("left knee flexion (degrees)") < names.index(errors)
    assert found["left knee flexion (degrees)"].origin == f"/{FLEXION}/left_knee"
    assert found["activity"].origin == f"/{ACTIVITY}"
    assert "- /world/estimate/body" in found[WORLD].contents  # the surface stands for the limbs
    assert found[errors].contents == ["/metrics/error_abs_mm"]  # a fit's heaviest particle is the expected pose


def test_shares_of_cues_have_a_view_of_their_own():
    metrics = ("error_abs_mm", "ess", "share_background", "share_edges")
    found = {view.name: view for view in views(layout.layout(replace(SHOWN, metrics=metrics)).root_container)}
    together = next(view for name, view in found.items() if name.startswith("shares of the cues"))
    assert together.contents == ["/metrics/share_background", "/metrics/share_edges"]
    assert "share edges" not in found


def test_without_activity_and_surface_their_views_are_left_out():
    plain = replace(SHOWN, activity=False, surface=False)
    found = {view.name: view for view in views(layout.layout(plain).root_container)}
    assert "activity" not in found
    assert "- /world/estimate/body" not in found[WORLD].contents
