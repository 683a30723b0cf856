"""What became of a run, by what was measured: each kind of finding, and none where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, HEIGHT_M, RATE_HZ, N, RunInputs, cameras, scene

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.calibration_findings import unit_of, usual_height
from workbench.evaluation.camera_agreement import pair_separations
from workbench.evaluation.finding import (
    DOUBTFUL,
    NOT_USABLE,
    NOTE,
    TRUSTWORTHY,
    Finding,
    conclusion,
    level_of,
    problems,
)
from workbench.evaluation.multiview_consistency import bends, limb_lengths, triangulate_rays
from workbench.evaluation.observed_joints import ObservedJoints
from workbench.evaluation.track_loss import FOREARM_OVER_HEIGHT, TRACKED_MM, track_metrics
from workbench.evaluation.verdict import Verdict

LATE = np.arange(N) >= 20
INPUTS = RunInputs(height_m=HEIGHT_M, max_iterations=40, rate_hz=RATE_HZ)


def standing(knee=0.6):
    """Joints (1, J, 3) of a person who faces x, with bent knees."""
    pose = np.zeros(len(BODY.skeleton.dof_names))
    pose[2] = 0.95
    for side in ("left", "right"):
        pose[BODY.skeleton.dof(f"{side}_knee_flexion")] = knee
        pose[BODY.skeleton.dof(f"{side}_hip_flexion")] = 0.5 * knee
    return joints(BODY.skeleton, pose[None])


def observed(rig, shown=None, places=None):
    """What the cameras `shown`, or the rig, show of a standing person."""
    places = standing() if places is None else places
    pixels = np.array([camera.project(places) for camera in shown or rig])
    keypoints = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    return ObservedJoints(tuple(rig), keypoints, np.ones(len(rig), bool), times_s=np.arange(len(places)) / RATE_HZ)


def test_rays_of_cameras_meet_where_the_joints_are():
    rig = cameras(3)
    seen = observed(rig)
    places = triangulate_rays(list(zip(rig, seen.pixels()[:, 0], strict=True)))
    np.testing.assert_allclose(places, standing()[0], atol=1e-6)
    assert max(each.max() for each in pair_separations(seen).values()) < 1e-6
    assert usual_height(limb_lengths(places[None])) == pytest.approx(HEIGHT_M, rel=1e-6)


def test_rays_of_exchanged_cameras_pass_each_other():
    a, b, c = cameras(3)
    apart = pair_separations(observed((a, b, c), (b, a, c), standing() + np.array([0.7, 0.3, 0.0])))
    assert max(each.max() for each in apart.values()) > FOREARM_OVER_HEIGHT


def test_knees_bend_forwards_and_backwards_where_the_sides_are_exchanged():
    right = standing()
    order = [JOINT_NAMES.index(name.replace("left", "?").replace("right", "left").replace("?", "right"))
             for name in JOINT_NAMES]  # fmt: skip
    assert (bends(right) > 0.0).all()
    assert len(bends(right)) == 2
    assert (bends(right[:, order]) < 0.0).all()
    assert not len(bends(standing(knee=0.0)))
    right[:, JOINT_NAMES.index("neck")] = np.nan
    assert (bends(right) > 0.0).all()


def test_heights_and_motion_of_keypoints():
    seen = observed(cameras(1), places=np.concatenate([standing(), standing() + np.array([0.1, 0.0, 0.0])]))
    seen.keypoints[0, :, 3, 2] = 0.0
    heights = np.ptp(np.delete(seen.keypoints[0, :, :, 1], 3, axis=1), axis=1)
    np.testing.assert_allclose(seen.heights_px[:, 0], heights)
    steps = np.delete(np.linalg.norm(np.diff(seen.keypoints[0, ..., :2], axis=0)[0], axis=1), 3)
    assert np.isnan(seen.motion[0])
    assert seen.motion[1] == pytest.approx(np.median(steps) / heights[1])
    assert seen.shows_person.all()


def test_the_level_is_the_worst_and_its_reasons_come_first():
    found = [Finding("a", "fits", TRUSTWORTHY), Finding("b", "note", NOTE), Finding("c", "odd"),
             Finding("d", "wrong", NOT_USABLE)]  # fmt: skip
    assert [level_of(found[:n]) for n in range(5)] == [TRUSTWORTHY] * 3 + [DOUBTFUL, NOT_USABLE]
    assert [each.kind for each in problems(found)] == ["d", "c"]
    assert conclusion(found) == "not usable, because wrong; odd"
    assert conclusion(found[:2]) == "trustworthy"
    many = Verdict(tuple(Finding(str(k), f"reason {k}") for k in range(5)), Finding("tracked", "ok", TRUSTWORTHY), ())
    assert (many.level, many.kind) == (DOUBTFUL, "0")
    assert "reason 2; and 2 more reasons: ok" in many.message
    assert [each["level"] for each in many.as_dict["findings"]] == [DOUBTFUL] * 5 + [TRUSTWORTHY]


def test_units_are_named_by_their_factor():
    assert [unit_of(ratio) for ratio in (1000.0, 80.0, 1.2, 400.0)] == ["millimetres", "centimetres", None, None]


def without(intact, joints_=(), frames=(), v=slice(None)):
    keypoints = intact.keypoints.copy()
    keypoints[v, :, list(joints_)] = np.nan
    keypoints[v, list(frames)] = np.nan
    return replace(intact, keypoints=keypoints)


def shifted(intact, down_px, frames):
    """The last camera's keypoints are too low in some frames."""
    keypoints = intact.keypoints.copy()
    keypoints[-1, frames, :, 1] += down_px
    return replace(intact, keypoints=keypoints)


def jumping(intact, by_px):
    keypoints = intact.keypoints.copy()
    keypoints[:, LATE, :, 0] += by_px
    return replace(intact, keypoints=keypoints)


ONE, TWO = scene(1), scene(2)


@pytest.mark.parametrize(
    ("kind", "planted"),
    [
        ("inconsistent cameras", without(TWO, frames=range(N - 5), v=1)),
        ("inconsistent cameras", shifted(TWO, 50.0, np.arange(N) >= 0)),
        ("too few observations", without(ONE, joints_=[1, 2, 3, 4, 5, 6, 7, 8, 12])),
        ("missing frames or jumps", without(TWO, frames=range(20, 30))),
        ("missing frames or jumps", jumping(ONE, 60.0)),
        ("observations far from the body", replace(ONE, inlier_fraction=0.4)),
    ],
)
def test_contradictions_of_the_keypoints_make_a_run_doubtful(kind, planted):
    found = planted.verdict()
    assert kind in {each.kind for each in found.findings}, found.message
    assert found.level != TRUSTWORTHY


def test_cameras_that_part_later_say_from_when_on():
    assert "from 0.80 s on" in shifted(TWO, 40.0, LATE).verdict().message


@pytest.mark.parametrize("height_m", [1.6, 1.8])
def test_a_height_that_is_nearly_right_has_no_finding(height_m):
    assert replace(TWO, inputs=replace(INPUTS, height_m=height_m)).verdict().findings == ()


def test_keypoints_in_a_few_frames_are_no_gaps():
    few = without(ONE, frames=[k for k in range(N) if k % 9])
    assert few.verdict().findings == ()


def test_ground_truth_decides_whether_the_person_is_tracked():
    lost = {"mpjpe_px": np.where(LATE, 50.0, 3.0), "forearm_width_px": np.full(N, 20.0),
            "mpjpe_abs_mm": np.where(LATE, 400.0, 30.0)}  # fmt: skip
    found = replace(ONE, errors=lost).verdict()
    assert (found.outcome.kind, found.level) == ("lost", NOT_USABLE)
    assert "from frame 20" in found.message
    assert (found.states[5], found.states[25]) == ("tracked", "lost")
    fraction = track_metrics({name: values[1:] for name, values in lost.items()})["lost_fraction"]
    assert f"{fraction:.0%} of the frames" in found.message
    tracked = replace(scene(0), errors={"mpjpe_abs_mm": np.full(N, TRACKED_MM - 10.0)}).verdict()
    assert (tracked.outcome.kind, tracked.level) == ("tracked", TRUSTWORTHY)


def test_a_short_loss_makes_a_run_doubtful():
    short = {"mpjpe_px": np.where(LATE & (np.arange(N) < 30), 50.0, 3.0), "forearm_width_px": np.full(N, 20.0)}
    found = replace(without(ONE, frames=range(N)), errors=short).verdict()
    assert (found.outcome.kind, found.level) == ("lost", DOUBTFUL)
    assert "recovered from frame 30" in found.message


def test_without_ground_truth_keypoints_decide():
    away = jumping(ONE, 60.0).verdict()
    assert (away.outcome.kind, away.states[-1]) == ("lost", "lost")


def test_annotations_of_the_first_frame_are_not_counted_and_frames_without_any_are_not_judged():
    px = np.where(np.isin(np.arange(N), [10, 20]), 10.0, np.nan)
    px[0] = 2.0
    errors = {"mpjpe_px": px, "forearm_width_px": np.where(np.isfinite(px), 13.0, np.nan)}
    marks = np.where(np.isfinite(px)[:, None, None], ONE.keypoints[0, ..., :2], np.nan)
    blind = without(ONE, frames=range(N))
    found = replace(blind, annotations=marks, errors=errors).verdict()
    assert "10.0 px from the joints annotated in 2 frames" in found.message
    assert [k for k, state in enumerate(found.states) if state == "tracked"] == [0, 10, 20]


def test_where_nothing_is_visible_nothing_is_trusted():
    blind = without(ONE, frames=range(N))
    images = blind.verdict()
    assert (images.outcome.kind, images.level, set(images.states)) == ("no ground truth", DOUBTFUL, {""})
    empty = replace(blind, inputs=replace(INPUTS, shows_person=False)).verdict()
    assert (empty.kind, empty.level) == ("no person visible", NOT_USABLE)
