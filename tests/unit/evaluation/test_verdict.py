"""What became of a run, by what was measured: each kind of finding, and none where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import View
from workbench.evaluation.multiview_consistency import bends, limb_lengths, triangulate_views
from workbench.evaluation.run_measurements import RunMeasurements
from workbench.evaluation.verdict import FOREARM_OVER_HEIGHT, TRACKED_MM, RunInputs, usual_height, verdict

N = 30
BODY = person(from_height(1.7))
IMAGE = np.zeros((2, 2), dtype=np.uint8)
CAMERAS = tuple(
    plain_camera(640, 480, 500.0, position, (0.0, 0.0, 1.0), name)
    for name, position in (("a", (4.0, 0.0, 1.5)), ("b", (0.0, 4.0, 1.2)), ("c", (-3.0, -2.0, 1.6)))
)


def standing(knee=0.6):
    """Joints (1, J, 3) of somebody who faces x, with bent knees."""
    pose = np.zeros(len(BODY.skeleton.dof_names))
    pose[2] = 0.95
    for side in ("left", "right"):
        pose[BODY.skeleton.dof(f"{side}_knee_flexion")] = knee
        pose[BODY.skeleton.dof(f"{side}_hip_flexion")] = 0.5 * knee
    return joints(BODY.skeleton, pose[None])


def views(cameras=CAMERAS, shown=CAMERAS, aside_m=(0.0, 0.0, 0.0)):
    """What the cameras `shown` see of somebody who stands aside of where they look, said of `cameras`."""
    places = standing()[0] + aside_m
    marks = [np.column_stack([camera.project(places), np.ones(len(places))]) for camera in shown]
    return [View(camera, IMAGE, each) for camera, each in zip(cameras, marks, strict=True)]


def measured(**changes):
    lengths = {limb: float(getattr(BODY.shape, limb)) for limb in ("upper_arm", "forearm", "thigh", "calf")}
    quiet = RunMeasurements(
        frames=np.arange(N) + 100, times_s=np.arange(N) / 30.0, cameras=("a", "b"),
        keypoint_error_px=np.full((N, 2), 4.0),
        person_height_px=np.full((N, 2), 400.0), in_image=np.ones((N, 2), bool), has_person=np.ones((N, 2), bool),
        ray_separation={("a", "b"): np.full(N, 0.01)}, triangulated_joints=np.repeat(standing(), N, axis=0),
        keypoint_motion=np.full(N, 0.01),
        observed_joints=np.ones(len(JOINT_NAMES), bool), errors={}, annotation_height_px=np.full(N, np.nan),
        lengths_m=lengths,
        inlier_fraction=np.full(N, 0.9), uncertain_groups=((),) * N, iterations=7.0, has_points=False,
    )  # fmt: skip
    return replace(quiet, **changes)


TOLD = RunInputs(height_m=1.7, max_iterations=40, rate_hz=30.0)


def test_rays_of_cameras_meet_where_the_joints_are():
    apart, places = triangulate_views(views())
    np.testing.assert_allclose(places, standing()[0], atol=1e-6)
    assert max(apart.values()) < 1e-6
    assert usual_height(limb_lengths(places[None])) == pytest.approx(1.7, rel=1e-6)


def test_rays_of_exchanged_cameras_pass_each_other():
    a, b, c = CAMERAS
    apart = triangulate_views(views(cameras=(a, b, c), shown=(b, a, c), aside_m=(0.7, 0.3, 0.0)))[0]
    assert max(apart.values()) > FOREARM_OVER_HEIGHT


def test_knees_bend_forwards_and_backwards_where_the_sides_are_exchanged():
    right = standing()
    order = [JOINT_NAMES.index(name.replace("left", "?").replace("right", "left").replace("?", "right"))
             for name in JOINT_NAMES]  # fmt: skip
    assert (bends(right) > 0.0).all()
    assert len(bends(right)) == 2
    assert (bends(right[:, order]) < 0.0).all()
    assert not len(bends(standing(knee=0.0)))


def test_a_quiet_run_is_accused_of_nothing():
    found = verdict(measured(), TOLD)
    assert (found.kind, found.findings) == ("no ground truth", ())
    assert "4.0 px" in found.message
    assert set(found.states) == {"tracked"}


def late(value, usual=0.01):
    return np.where(np.arange(N) < 12, usual, value)


BACKWARDS = np.repeat(standing() * np.array([-1.0, 1.0, 1.0]), N, axis=0)
FEW = np.isin(np.arange(len(JOINT_NAMES)), [2, 3, 4, 5])
GAP = np.repeat((np.arange(N) < 10) | (np.arange(N) > 20), 2).reshape(N, 2)


@pytest.mark.parametrize(
    ("kind", "changes", "told"),
    [
        ("inconsistent cameras", {"ray_separation": {("a", "b"): np.full(N, 0.1)}}, {}),
        ("inconsistent cameras", {"ray_separation": {("a", "b"): late(0.1)}}, {}),
        ("inconsistent cameras", {"has_person": np.tile([True, False], (N, 1))}, {}),
        ("too few observations", {"observed_joints": FEW}, {}),
        ("left–right swap", {"triangulated_joints": BACKWARDS}, {}),
        ("height mismatch", {}, {"height_m": 1.7 * 1.15}),
        ("height mismatch", {}, {"height_m": 1.7 / 1.15}),
        (
            "implausible limb lengths",
            {"lengths_m": {"upper_arm": 0.31, "forearm": 0.25, "thigh": 0.42, "calf": 0.28}},
            {},
        ),
        ("frame-rate mismatch", {}, {"source_rate_hz": 60.0}),
        ("missing frames or jumps", {"keypoint_motion": np.where(np.arange(N) == 15, 0.2, 0.01)}, {}),
        ("missing frames or jumps", {"has_person": GAP}, {}),
        ("observations far from the body", {"inlier_fraction": np.full(N, 0.4)}, {}),
        ("not converged", {"iterations": 40.0}, {}),
    ],
)
def test_what_does_not_fit_together_comes_first(kind, changes, told):
    found = verdict(measured(**changes), replace(TOLD, **told))
    assert found.kind == kind
    assert found.message.startswith(f"{kind}: ")
    assert found.as_dict["kind"] == kind


def test_cameras_that_part_later_say_from_which_frame():
    assert "from frame 112 on" in verdict(measured(ray_separation={("a", "b"): late(0.1)}), TOLD).message


@pytest.mark.parametrize("height_m", [1.6, 1.8])
def test_a_height_that_is_nearly_right_is_not_accused(height_m):
    assert verdict(measured(), replace(TOLD, height_m=height_m)).findings == ()


def test_marks_in_a_few_frames_are_no_gaps():
    few = np.repeat(np.isin(np.arange(N), [0, 9, 18, 27])[:, None], 2, axis=1)
    assert verdict(measured(has_person=few, in_image=np.zeros((N, 2), bool)), TOLD).findings == ()


def test_a_kick_is_no_jump():
    assert verdict(measured(keypoint_motion=np.where(np.abs(np.arange(N) - 15) < 3, 0.1, 0.03)), TOLD).findings == ()


def test_the_truth_decides_who_was_held():
    lost = {"mpjpe_px": late(50.0, 3.0), "forearm_width_px": np.full(N, 20.0), "mpjpe_abs_mm": late(400.0, 30.0)}
    found = verdict(measured(errors=lost), TOLD)
    assert found.kind == "lost"
    assert "from frame 112" in found.message
    assert "MPJPE" in found.message
    assert (found.states[5], found.states[20]) == ("tracked", "lost")
    held = {"mpjpe_abs_mm": np.full(N, TRACKED_MM - 10.0)}
    assert verdict(measured(errors=held), TOLD).kind == "tracked"


def test_who_is_lost_without_truth_is_told_by_the_keypoints():
    found = verdict(measured(keypoint_error_px=np.repeat(late(60.0, 3.0)[:, None], 2, axis=1)), TOLD)
    assert found.kind == "lost"


def test_marks_that_were_held_out_are_told_beside_the_keypoints_and_frames_without_any_are_not_judged():
    few = np.isin(np.arange(N), [3, 4, 20])
    marks = {"errors": {"mpjpe_px": np.where(np.arange(N) == 20, 30.0, np.nan)},
             "annotation_height_px": np.where(np.arange(N) == 20, 300.0, np.nan)}  # fmt: skip
    found = verdict(measured(keypoint_error_px=np.where(few[:, None], 4.0, np.nan) * np.ones(2), **marks), TOLD)
    assert "30.0 px from the joints annotated in 1 frames, 10.0% of the person's height" in found.message
    assert [k for k, state in enumerate(found.states) if state == "tracked"] == [0, 3, 4, 20]


def test_marks_of_the_first_frame_from_which_a_run_starts_are_not_counted():
    px = np.where(np.isin(np.arange(N), [10, 20]), 30.0, np.nan)
    px[0] = 2.0
    marks = {"errors": {"mpjpe_px": px}, "annotation_height_px": np.where(np.isfinite(px), 300.0, np.nan)}
    assert "30.0 px from the joints annotated in 2 frames, 10.0%" in verdict(measured(**marks), TOLD).message
    px[1:] = np.nan
    assert "annotated" not in verdict(measured(**marks), TOLD).message


def test_where_nothing_is_seen_nothing_is_judged():
    blind = {"observed_joints": np.zeros(len(JOINT_NAMES), bool), "has_person": np.zeros((N, 2), bool),
             "cameras": ("a",),
             "triangulated_joints": np.full((N, len(JOINT_NAMES), 3), np.nan), "ray_separation": {}}  # fmt: skip
    assert verdict(measured(**blind), replace(TOLD, shows_person=False)).kind == "no person visible"
    assert "nothing to compare with" in verdict(measured(**blind), TOLD).message
