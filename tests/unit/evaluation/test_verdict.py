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
from workbench.evaluation.evidence import RunMeasurements
from workbench.evaluation.multiview_consistency import bends, limb_lengths, meeting
from workbench.evaluation.verdict import FOREARM, HELD_MM, RunInputs, usual_height, verdict

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
        frames=np.arange(N) + 100, times_s=np.arange(N) / 30.0, cameras=("a", "b"), off_px=np.full((N, 2), 4.0),
        height_px=np.full((N, 2), 400.0), expected=np.ones((N, 2), bool), found=np.ones((N, 2), bool),
        apart={("a", "b"): np.full(N, 0.01)}, joints=np.repeat(standing(), N, axis=0), moved=np.full(N, 0.01),
        marked=np.ones(len(JOINT_NAMES), bool), errors={}, mark_height_px=np.full(N, np.nan), lengths_m=lengths,
        inliers=np.full(N, 0.9), doubted=((),) * N, iterations=7.0, has_points=False,
    )  # fmt: skip
    return replace(quiet, **changes)


TOLD = RunInputs(height_m=1.7, max_iterations=40, rate_hz=30.0)


def test_rays_of_cameras_meet_where_the_joints_are():
    apart, places = meeting(views())
    np.testing.assert_allclose(places, standing()[0], atol=1e-6)
    assert max(apart.values()) < 1e-6
    assert usual_height(limb_lengths(places[None])) == pytest.approx(1.7, rel=1e-6)


def test_rays_of_exchanged_cameras_pass_each_other():
    a, b, c = CAMERAS
    apart = meeting(views(cameras=(a, b, c), shown=(b, a, c), aside_m=(0.7, 0.3, 0.0)))[0]
    assert max(apart.values()) > FOREARM


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
    assert (found.kind, found.findings) == ("no truth", ())
    assert "4.0 px" in found.sentence
    assert set(found.states) == {"held"}


def late(value, usual=0.01):
    return np.where(np.arange(N) < 12, usual, value)


BACKWARDS = np.repeat(standing() * np.array([-1.0, 1.0, 1.0]), N, axis=0)
FEW = np.isin(np.arange(len(JOINT_NAMES)), [2, 3, 4, 5])
GAP = np.repeat((np.arange(N) < 10) | (np.arange(N) > 20), 2).reshape(N, 2)


@pytest.mark.parametrize(
    ("kind", "changes", "told"),
    [
        ("cameras disagree", {"apart": {("a", "b"): np.full(N, 0.1)}}, {}),
        ("cameras disagree", {"apart": {("a", "b"): late(0.1)}}, {}),
        ("cameras disagree", {"found": np.tile([True, False], (N, 1))}, {}),
        ("too few observations", {"marked": FEW}, {}),
        ("left and right", {"joints": BACKWARDS}, {}),
        ("height", {}, {"height_m": 1.7 * 1.15}),
        ("height", {}, {"height_m": 1.7 / 1.15}),
        ("limb lengths", {"lengths_m": {"upper_arm": 0.31, "forearm": 0.25, "thigh": 0.42, "calf": 0.28}}, {}),
        ("rate", {}, {"source_rate_hz": 60.0}),
        ("frames missing", {"moved": np.where(np.arange(N) == 15, 0.2, 0.01)}, {}),
        ("frames missing", {"found": GAP}, {}),
        ("far from what is seen", {"inliers": np.full(N, 0.4)}, {}),
        ("not converged", {"iterations": 40.0}, {}),
    ],
)
def test_what_does_not_fit_together_comes_first(kind, changes, told):
    found = verdict(measured(**changes), replace(TOLD, **told))
    assert found.kind == kind
    assert found.sentence.startswith(f"{kind}: ")
    assert found.as_dict["kind"] == kind


def test_cameras_that_part_later_say_from_which_frame():
    assert "from frame 112 on" in verdict(measured(apart={("a", "b"): late(0.1)}), TOLD).sentence


@pytest.mark.parametrize("height_m", [1.6, 1.8])
def test_a_height_that_is_nearly_right_is_not_accused(height_m):
    assert verdict(measured(), replace(TOLD, height_m=height_m)).findings == ()


def test_marks_in_a_few_frames_are_no_gaps():
    few = np.repeat(np.isin(np.arange(N), [0, 9, 18, 27])[:, None], 2, axis=1)
    assert verdict(measured(found=few, expected=np.zeros((N, 2), bool)), TOLD).findings == ()


def test_a_kick_is_no_jump():
    assert verdict(measured(moved=np.where(np.abs(np.arange(N) - 15) < 3, 0.1, 0.03)), TOLD).findings == ()


def test_the_truth_decides_who_was_held():
    lost = {"error_px": late(50.0, 3.0), "forearm_px": np.full(N, 20.0), "error_abs_mm": late(400.0, 30.0)}
    found = verdict(measured(errors=lost), TOLD)
    assert found.kind == "lost"
    assert "from frame 112" in found.sentence
    assert "MPJPE" in found.sentence
    assert (found.states[5], found.states[20]) == ("held", "lost")
    held = {"error_abs_mm": np.full(N, HELD_MM - 10.0)}
    assert verdict(measured(errors=held), TOLD).kind == "held"


def test_who_is_lost_without_truth_is_told_by_the_keypoints():
    found = verdict(measured(off_px=np.repeat(late(60.0, 3.0)[:, None], 2, axis=1)), TOLD)
    assert found.kind == "lost"


def test_marks_that_were_held_out_are_told_beside_the_keypoints_and_frames_without_any_are_not_judged():
    few = np.isin(np.arange(N), [3, 4, 20])
    marks = {"errors": {"error_px": np.where(np.arange(N) == 20, 30.0, np.nan)},
             "mark_height_px": np.where(np.arange(N) == 20, 300.0, np.nan)}  # fmt: skip
    found = verdict(measured(off_px=np.where(few[:, None], 4.0, np.nan) * np.ones(2), **marks), TOLD)
    assert "30.0 px from the joints marked in 1 frames, 10.0% of the person's height" in found.sentence
    assert [k for k, state in enumerate(found.states) if state == "held"] == [0, 3, 4, 20]


def test_marks_of_the_first_frame_from_which_a_run_starts_are_not_counted():
    px = np.where(np.isin(np.arange(N), [10, 20]), 30.0, np.nan)
    px[0] = 2.0
    marks = {"errors": {"error_px": px}, "mark_height_px": np.where(np.isfinite(px), 300.0, np.nan)}
    assert "30.0 px from the joints marked in 2 frames, 10.0%" in verdict(measured(**marks), TOLD).sentence
    px[1:] = np.nan
    assert "marked" not in verdict(measured(**marks), TOLD).sentence


def test_where_nothing_is_seen_nothing_is_judged():
    blind = {"marked": np.zeros(len(JOINT_NAMES), bool), "found": np.zeros((N, 2), bool), "cameras": ("a",),
             "joints": np.full((N, len(JOINT_NAMES), 3), np.nan), "apart": {}}  # fmt: skip
    assert verdict(measured(**blind), replace(TOLD, seen=False)).kind == "not seen"
    assert "nothing to measure by" in verdict(measured(**blind), TOLD).sentence
