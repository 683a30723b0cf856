"""Verdicts on a run: measurements of keypoints, findings by kind, and the outcome by truth or keypoints."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, HEIGHT_M, RATE_HZ, N, RunInputs, cameras, scene, walk

from workbench.body.kinematics import joints
from workbench.body.stature import limb_lengths, usual_height
from workbench.cameras.calibration_findings import unit_of
from workbench.cameras.camera_agreement import pair_separations
from workbench.cameras.observed_joints import ObservedJoints
from workbench.cameras.triangulation import triangulate
from workbench.evaluation.errors.track_loss import TRACKED_MM, track_metrics
from workbench.evaluation.verdict.run_verdict import Verdict
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, NOTE, TRUSTWORTHY, Finding, conclusion, level_of, problems

LATE = np.arange(N) >= 20
INPUTS = RunInputs(height_m=HEIGHT_M, rate_hz=RATE_HZ)


def standing(knee=0.6):
    """Joints (1, J, 3) of a person who faces x, with bent knees."""
    pose = np.zeros(len(BODY.skeleton.dof_names))
    pose[2] = 0.95
    for side in ("left", "right"):
        pose[BODY.skeleton.dof(f"{side}_knee_flexion")] = knee
        pose[BODY.skeleton.dof(f"{side}_hip_flexion")] = 0.5 * knee
    return joints(BODY.skeleton, pose[None])


def observed(rig, shown=None, positions=None):
    """Return keypoints of a standing person in the images of the cameras `shown`, by default of the rig."""
    positions = standing() if positions is None else positions
    pixels = np.array([camera.project(positions) for camera in shown or rig])
    keypoints = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    return ObservedJoints(tuple(rig), keypoints, np.ones(len(rig), bool), times_s=np.arange(len(positions)) / RATE_HZ)


def test_rays_of_cameras_meet_in_the_joints():
    rig = cameras(3)
    keypoints = observed(rig)
    positions = triangulate(rig, keypoints.pixels()[:, 0])
    np.testing.assert_allclose(positions, standing()[0], atol=1e-6)
    assert max(separations.max() for separations in pair_separations(keypoints).values()) < 1e-6
    assert usual_height(limb_lengths(positions[None])) == pytest.approx(HEIGHT_M, rel=1e-6)


def test_heights_and_motion_of_keypoints():
    keypoints = observed(cameras(1), positions=np.concatenate([standing(), standing() + np.array([0.1, 0.0, 0.0])]))
    keypoints.keypoints[0, :, 3, 2] = 0.0
    heights = np.ptp(np.delete(keypoints.keypoints[0, :, :, 1], 3, axis=1), axis=1)
    np.testing.assert_allclose(keypoints.heights_px[:, 0], heights)
    steps = np.delete(np.linalg.norm(np.diff(keypoints.keypoints[0, ..., :2], axis=0)[0], axis=1), 3)
    assert np.isnan(keypoints.motion[0])
    assert keypoints.motion[1] == pytest.approx(np.median(steps) / heights[1])
    assert keypoints.shows_person.all()


def test_the_level_is_the_worst_and_its_reasons_come_first():
    findings = [Finding("a", "fits", TRUSTWORTHY), Finding("b", "note", NOTE), Finding("c", "odd"),
                Finding("d", "wrong", NOT_USABLE)]  # fmt: skip
    assert [level_of(findings[:n]) for n in range(5)] == [TRUSTWORTHY] * 3 + [DOUBTFUL, NOT_USABLE]
    assert [finding.kind for finding in problems(findings)] == ["d", "c"]
    assert conclusion(findings) == "not usable, because wrong; odd"
    assert conclusion(findings[:2]) == "trustworthy"
    many = Verdict(tuple(Finding(str(k), f"reason {k}") for k in range(5)), Finding("tracked", "ok", TRUSTWORTHY), ())
    assert (many.level, many.kind) == (DOUBTFUL, "0")
    assert "reason 2; and 2 more reasons: ok" in many.message
    assert [finding["level"] for finding in many.as_dict["findings"]] == [DOUBTFUL] * 5 + [TRUSTWORTHY]


def test_units_are_named_by_their_factor():
    assert [unit_of(ratio) for ratio in (1000.0, 80.0, 1.2, 200.0)] == ["millimetres", "centimetres", None, None]


def without(intact, joints_=(), frames=(), v=slice(None)):
    keypoints = intact.keypoints.copy()
    keypoints[v, :, list(joints_)] = np.nan
    keypoints[v, list(frames)] = np.nan
    return replace(intact, keypoints=keypoints)


def shifted(intact, down_px, frames):
    """Return the scene with lower keypoints of the last camera in some frames."""
    keypoints = intact.keypoints.copy()
    keypoints[-1, frames, :, 1] += down_px
    return replace(intact, keypoints=keypoints)


def jumping(intact, by_px):
    keypoints = intact.keypoints.copy()
    keypoints[:, LATE, :, 0] += by_px
    return replace(intact, keypoints=keypoints)


ONE, TWO = scene(1), scene(2)


def test_the_start_of_an_inconsistency_of_cameras_is_reported():
    assert "from 0.80 s on" in shifted(TWO, 40.0, LATE).verdict().message


@pytest.mark.parametrize("height_m", [1.6, 1.8])
def test_a_height_within_ten_centimetres_has_no_finding(height_m):
    assert replace(TWO, inputs=replace(INPUTS, height_m=height_m)).verdict().findings == ()


def test_keypoints_in_every_ninth_frame_are_no_gaps():
    sparse = without(ONE, frames=[k for k in range(N) if k % 9])
    assert sparse.verdict().findings == ()


def test_ground_truth_decides_whether_the_person_is_tracked():
    lost = {"mpjpe_px": np.where(LATE, 50.0, 3.0), "forearm_width_px": np.full(N, 20.0),
            "mpjpe_abs_mm": np.where(LATE, 400.0, 30.0)}  # fmt: skip
    verdict = replace(ONE, errors=lost).verdict()
    assert (verdict.outcome.kind, verdict.level) == ("lost", NOT_USABLE)
    assert "from frame 20" in verdict.message
    assert (verdict.states[5], verdict.states[25]) == ("tracked", "lost")
    fraction = track_metrics({name: values[1:] for name, values in lost.items()})["lost_fraction"]
    assert f"{fraction:.0%} of the frames" in verdict.message
    tracked = replace(scene(0), errors={"mpjpe_abs_mm": np.full(N, TRACKED_MM - 10.0)}).verdict()
    assert (tracked.outcome.kind, tracked.level) == ("tracked", TRUSTWORTHY)


def test_a_short_loss_makes_a_run_doubtful():
    short = {"mpjpe_px": np.where(LATE & (np.arange(N) < 30), 50.0, 3.0), "forearm_width_px": np.full(N, 20.0)}
    verdict = replace(without(ONE, frames=range(N)), errors=short).verdict()
    assert (verdict.outcome.kind, verdict.level) == ("lost", DOUBTFUL)
    assert "recovered from frame 30" in verdict.message


def test_without_ground_truth_keypoints_decide():
    verdict = jumping(ONE, 60.0).verdict()
    assert (verdict.outcome.kind, verdict.states[-1]) == ("lost", "lost")


def test_annotations_after_the_first_frame_decide_in_their_frames():
    px = np.where(np.isin(np.arange(N), [10, 20]), 10.0, np.nan)
    px[0] = 2.0
    errors = {"mpjpe_px": px, "forearm_width_px": np.where(np.isfinite(px), 13.0, np.nan)}
    annotations = np.where(np.isfinite(px)[:, None, None], ONE.keypoints[0, ..., :2], np.nan)
    without_keypoints = without(ONE, frames=range(N))
    verdict = replace(without_keypoints, annotations=annotations, errors=errors).verdict()
    assert "10.0 px from the joints annotated in 2 frames" in verdict.message
    assert [k for k, state in enumerate(verdict.states) if state == "tracked"] == [0, 10, 20]


def test_a_run_without_observations_is_a_sample_of_the_prior():
    without_keypoints = without(ONE, frames=range(N))
    images = without_keypoints.verdict()
    assert (images.outcome.kind, images.level, set(images.states)) == ("no ground truth", DOUBTFUL, {""})
    empty = replace(without_keypoints, inputs=replace(INPUTS, shows_person=False)).verdict()
    assert (empty.kind, empty.level) == ("no person visible", TRUSTWORTHY)
    assert empty.message == "trustworthy: nothing is observed, the motion is a sample of the prior"


def test_a_camera_that_travels_makes_positions_doubtful():
    still, travelling = (replace(ONE, inputs=replace(ONE.inputs, camera_travels=each)).verdict() for each in (0, 1))
    assert still.level == "trustworthy"
    assert (travelling.level, travelling.kind) == ("doubtful", "moving camera")
    assert "positions are relative to the camera" in travelling.message


def with_estimated_camera(intact, depth_m):
    """Return the scene with a camera whose focal length is uncertain, and particles spread along its line of sight."""
    (camera,) = intact.cameras
    by_focal = np.zeros((1, 23))
    by_focal[0, 12:14] = 0.1 * camera.row[12:14]
    return replace(intact, cameras=(replace(camera, uncertainty=by_focal),), depth_std_m=depth_m)


def test_the_distance_from_an_estimated_camera_is_stated_and_no_reason_to_doubt():
    known = replace(ONE, depth_std_m=1.0, expected_errors=True).verdict()
    estimated = replace(with_estimated_camera(ONE, 1.0), expected_errors=True).verdict()
    assert known.level == DOUBTFUL
    assert {"uncertain depth", "large expected error"} <= {finding.kind for finding in problems(known.findings)}
    assert estimated.level == TRUSTWORTHY, estimated.message
    assert "m as the camera is estimated" in estimated.message


def test_a_person_on_one_leg_stands_upright():
    poses = walk().copy()
    poses[:, BODY.skeleton.dof("left_hip_flexion")] = 1.6
    poses[:, BODY.skeleton.dof("left_knee_flexion")] = 0.2
    poses[:, 4:6] = 0.0
    raised = replace(ONE, poses=poses)
    assert "vertical" not in {finding.kind for finding in problems(raised.verdict().findings)}
