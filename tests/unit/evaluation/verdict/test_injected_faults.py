"""Each fault injected into an intact scene is reported with its level; intact scenes have no findings."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import HEIGHT_M, RATE_HZ, N, RunInputs, moved, point_scene, scene, walk, y_up

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.detections.association.keypoint_kalman import exchanged
from workbench.evaluation.verdict import run_measurements

LATE = np.arange(N) >= 20
FOUR, ONE, POINTS = scene(4), scene(1), point_scene()


def rescaled(intact, factor):
    keypoints = intact.keypoints.copy()
    keypoints[..., :2] *= factor
    return replace(intact, keypoints=keypoints)


def delayed(intact, v, n_frames):
    """Return the scene with a delay of camera v."""
    keypoints = intact.keypoints.copy()
    keypoints[v] = np.roll(keypoints[v], n_frames, axis=0)
    keypoints[v, :n_frames] = np.nan
    return replace(intact, keypoints=keypoints)


def mirrored(intact):
    order = exchanged("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    return replace(intact, keypoints=intact.keypoints[:, :, order])


def annotated(intact, distance_px):
    """Replace the keypoints by annotations in every tenth frame, at this distance from the estimate."""
    annotations = np.where(
        (np.arange(N) % 10 == 0)[:, None, None], intact.keypoints[0, ..., :2] + [distance_px, 0.0], np.nan
    )
    height = np.ptp(annotations[..., 1], axis=1)
    errors = {"mpjpe_px": np.where(np.isfinite(height), abs(distance_px), np.nan), "forearm_width_px": 0.044 * height}
    unknown = np.full_like(intact.keypoints, np.nan)
    return replace(intact, keypoints=unknown, annotations=annotations, errors=errors)


def with_truth(error_mm, error_px=2.0, aligned_mm=60.0, **metrics):
    """Return a scene with these errors in every frame; absolute errors are along the line of sight."""
    series = {"mpjpe_abs_mm": error_mm, "mpjpe_mm": aligned_mm, "mpjpe_px": error_px, "forearm_width_px": 20.0}
    errors = {name: np.broadcast_to(value, N) for name, value in (series | metrics).items()}
    offset_m = -1e-3 * np.broadcast_to(error_mm, N)[:, None] * ONE.cameras[0].rotation[2]
    return replace(ONE, errors=errors, truth_m=offset_m)


def raised(intact, up_m):
    """Return the scene with the walker and the cameras raised above the floor."""
    poses = intact.poses + np.eye(25)[2] * up_m
    rig = tuple(replace(c, translation=c.translation - up_m * c.rotation[:, 2]) for c in intact.cameras)
    return replace(intact, cameras=rig, poses=poses)


def off_centre(camera):
    return replace(camera, matrix=camera.matrix * [[1.5, 1, 1.5], [1, 1.5, 1.5], [1, 1, 1]])


SMALL = person(from_height(1.2))
SHIFT = np.array([1.0, 1.0, 1.0])
FAULTS = {
    "keypoints of four cameras in 0 to 1": (rescaled(FOUR, 1 / 1280), "keypoints outside the image", "not usable"),
    "keypoints of one camera in 0 to 1": (rescaled(ONE, 1 / 1280), "keypoints outside the image", "not usable"),
    "keypoints of a larger image": (rescaled(ONE, 3.0), "keypoints outside the image", "not usable"),
    "four cameras in mm": (replace(FOUR, cameras=moved(FOUR.cameras, 1e3)), "unit of length", "not usable"),
    "one camera in mm": (replace(ONE, cameras=moved(ONE.cameras, 1e3)), "unit of length", "not usable"),
    "points in mm": (replace(POINTS, points=1e3 * POINTS.points), "unit of length", "not usable"),
    "y-up, four cameras": (replace(FOUR, cameras=tuple(map(y_up, FOUR.cameras))), "vertical", "doubtful"),
    "y-up, one camera": (replace(ONE, cameras=tuple(map(y_up, ONE.cameras))), "vertical", "not usable"),
    "y-up points": (replace(POINTS, points=POINTS.points[..., [0, 2, 1]] * [1, 1, -1]), "vertical", "doubtful"),
    "drift in depth": (with_truth(np.where(LATE, 400.0, 50.0)), "depth drift", "doubtful"),
    "image size": (replace(ONE, cameras=tuple(map(off_centre, ONE.cameras))), "image size", "doubtful"),
    "10 km away": (replace(ONE, poses=walk() + 1e4 * np.eye(25)[1]), "distance", "not usable"),
    "implausibly small": (replace(ONE, body=person(from_height(0.8))), "height mismatch", "doubtful"),
    "four cameras in cm": (replace(FOUR, cameras=moved(FOUR.cameras, 1e2)), "unit of length", "not usable"),
    "one camera in cm": (replace(ONE, cameras=moved(ONE.cameras, 1e2)), "unit of length", "not usable"),
    "points in cm": (replace(POINTS, points=1e2 * POINTS.points), "unit of length", "not usable"),
    "times go back": (
        replace(ONE, times_s=np.where(LATE, 0.5, 1.0) * ONE.times_s), "frame-rate mismatch", "not usable"
    ),
    "rate of the file": (
        replace(ONE, inputs=RunInputs(HEIGHT_M, rate_hz=RATE_HZ, source_rate_hz=50.0)), "frame-rate mismatch",
        "doubtful",
    ),
    "times of another rate": (replace(ONE, times_s=0.5 * ONE.times_s), "frame-rate mismatch", "doubtful"),
    "a camera 0.2 s late": (delayed(FOUR, 2, 5), "unsynchronized cameras", "doubtful"),
    "one of two cameras 0.12 s late": (delayed(scene(2), 1, 3), "unsynchronized cameras", "doubtful"),
    "exchanged cameras": (
        replace(FOUR, keypoints=FOUR.keypoints[[1, 0, 2, 3]]), "exchanged cameras", "not usable"
    ),
    "left and right": (mirrored(FOUR), "left–right swap", "not usable"),
    "left and right, one camera": (
        replace(ONE, poses=walk() + np.pi * np.eye(25)[3]), "left–right swap", "doubtful"
    ),
    "height of 1.2 m": (replace(FOUR, inputs=RunInputs(1.2, rate_hz=RATE_HZ)), "height mismatch", "not usable"),
    "height of 1.2 m, one camera": (
        replace(ONE, inputs=RunInputs(1.2, rate_hz=RATE_HZ)), "ground contact", "doubtful"
    ),
    "long forearms": (
        replace(FOUR, body=person(from_height(HEIGHT_M, forearm=0.36))), "implausible limb lengths", "doubtful"
    ),
    "few inliers": (replace(FOUR, inlier_fraction=0.1), "observations far from the body", "not usable"),
    "floor": (raised(FOUR, 0.6), "ground contact", "doubtful"),
    "sliding": (replace(ONE, poses=np.tile(walk()[:1], (N, 1)) + np.linspace(-1, 1, N)[:, None] * np.eye(25)[0]),
                "ground contact", "doubtful"),
    "overconfident": (with_truth(60.0, coverage_90=0.5), "overconfident", "doubtful"),
    "depth unknown": (with_truth(60.0, expected_error_root_mm=600.0), "large expected error", "doubtful"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_an_injected_fault_is_reported_with_its_level(name):
    faulty, kind, level = FAULTS[name]
    verdict = faulty.verdict()
    levels = {finding.kind: finding.level for finding in (*verdict.findings, verdict.outcome)}
    assert levels.get(kind) == level, verdict.message
    assert verdict.level != "trustworthy"
    assert verdict.message.startswith(verdict.level)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_intact_cameras_have_no_findings(n):
    verdict = scene(n).verdict()
    assert (verdict.level, verdict.findings) == ("trustworthy", ()), verdict.message
    assert set(verdict.states) == {"tracked"}


def test_other_intact_scenes_have_no_findings():
    for intact in (POINTS, annotated(ONE, 5.0), with_truth(60.0, coverage_90=0.9), raised(FOUR, 0.05)):
        verdict = intact.verdict()
        assert (verdict.level, verdict.findings) == ("trustworthy", ()), verdict.message


def test_an_estimate_far_from_its_annotations_is_lost():
    verdict = annotated(ONE, 416.0).verdict()
    assert (verdict.outcome.kind, verdict.level) == ("lost", "not usable")
    assert "416.0 px from the joints annotated in 5 frames" in verdict.message
    assert {verdict.states[k] for k in (10, 20, 50)} == {"lost"}


def test_states_follow_errors_and_expected_errors():
    lost = with_truth(60.0, aligned_mm=np.where(LATE, 210.0, 50.0)).verdict()
    assert (lost.outcome.kind, lost.states[5], lost.states[-1]) == ("lost", "tracked", "lost")
    assert "lost from frame 20: root-aligned MPJPE 210 mm" in lost.message
    uncertain = with_truth(60.0, expected_error_legs_mm=np.where(LATE, 600.0, 20.0)).verdict()
    assert (uncertain.states[5], uncertain.states[-1]) == ("tracked", "doubtful")


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_depth_drift_of_a_tracked_and_of_a_lost_person_is_reported(sign):
    drift = with_truth(sign * np.where(LATE, 260.0, 50.0))
    drift = replace(drift, errors=drift.errors | {"mpjpe_abs_mm": np.where(LATE, 260.0, 50.0)})
    verdict = drift.verdict()
    assert (verdict.outcome.kind, verdict.states[5], verdict.states[-1]) == ("tracked", "tracked", "doubtful")
    assert verdict.message.count("depth drifted by 260 mm") == 1
    lost = replace(drift, errors=drift.errors | {"mpjpe_mm": np.where(LATE, 210.0, 50.0)}).verdict()
    assert lost.outcome.kind == "lost"
    assert "depth drifted by 260 mm" in lost.message


def test_depth_drift_within_its_interval_is_no_problem(monkeypatch):
    monkeypatch.setattr(run_measurements, "_depth_std", lambda step: 0.2)  # its 90 % interval is ± 329 mm
    verdict = with_truth(260.0).verdict()
    assert (verdict.level, set(verdict.states)) == ("trustworthy", {"tracked"})
    assert "depth drifted by 260 mm, within its 90 % interval" in verdict.message
