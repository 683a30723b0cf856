"""States of joints by detections, annotations, truth and landmarks, and the findings on them."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, N, scene, walk, with_landmarks

from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.verdict.joint_states import joint_states, lasting, running_median, stretches
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, TRUSTWORTHY, problems

ONE, FOUR = scene(1, sigma_px=0.0), scene(4, sigma_px=0.0)
WRIST, KNEE = JOINT_NAMES.index("left_wrist"), JOINT_NAMES.index("right_knee")
LATE = np.arange(N) >= 20


def heights_px(intact):
    return np.ptp(intact.keypoints[..., 1], axis=2)


def displaced(intact, joint, share, frames, views=slice(None)):
    """Return the scene with keypoints of a joint at a distance from the estimate, by a share of the person's height."""
    keypoints = intact.keypoints.copy()
    inside = keypoints[views][:, frames, joint, 0]
    keypoints[views, frames, joint, 0] = inside + share * heights_px(intact)[views][:, frames]
    return replace(intact, keypoints=keypoints)


def kinds(verdict):
    return {finding.kind: finding.level for finding in problems(verdict.findings)}


@pytest.mark.parametrize(
    ("share", "state"), [(0.057, "tracked"), (0.059, DOUBTFUL), (0.115, DOUBTFUL), (0.118, "lost")]
)
def test_the_distance_from_its_detections_decides_about_a_joint(share, state):
    verdict = displaced(ONE, WRIST, share, LATE).verdict()
    assert (verdict.joint_states["left_arm"][10], verdict.joint_states["left_arm"][40]) == ("tracked", state)
    assert verdict.joint_states["right_leg"][40] == "tracked"
    assert verdict.states[40] == ("tracked" if state == "tracked" else DOUBTFUL)
    assert ("joints far from detections" in kinds(verdict)) == (state != "tracked")


@pytest.mark.parametrize(("n", "is_confusion"), [(5, True), (6, False)])
def test_a_detector_may_confuse_joints_for_a_moment(n, is_confusion):
    """0.2 s are 5 frames at 25 Hz."""
    states = displaced(ONE, WRIST, 0.2, slice(20, 20 + n)).verdict().joint_states["left_arm"]
    assert (set(states) == {"tracked"}) == is_confusion


@pytest.mark.parametrize(("n", "is_reported"), [(12, False), (13, True)])
def test_a_joint_that_is_far_for_half_a_second_is_reported(n, is_reported):
    verdict = displaced(ONE, WRIST, 0.2, slice(20, 20 + n)).verdict()
    assert ("joints far from detections" in kinds(verdict)) == is_reported


def test_one_of_four_cameras_does_not_decide_about_a_joint():
    assert set(displaced(FOUR, WRIST, 0.2, LATE, [0]).verdict().joint_states["left_arm"]) == {"tracked"}


def test_a_joint_without_detections_is_not_seen():
    keypoints = ONE.keypoints.copy()
    keypoints[:, 20:, [WRIST, WRIST - 1], 2] = 0.29
    states = replace(ONE, keypoints=keypoints).verdict().joint_states["left_arm"]
    assert (states[10], states[50]) == ("tracked", "not seen")
    keypoints[:, 20:, [WRIST, WRIST - 1], 2] = 0.3
    assert set(replace(ONE, keypoints=keypoints).verdict().joint_states["left_arm"]) == {"tracked"}


def test_a_recovery_is_that_of_every_joint():
    lost = ONE
    for joint in range(1, 15):
        lost = displaced(lost, joint, 0.2, slice(10, 30))
    assert "recovered from frame 30," in lost.verdict().message
    assert "recovered from frame 40," in displaced(lost, WRIST, 0.2, slice(30, 40)).verdict().message
    to_the_end = displaced(displaced(lost, WRIST, 0.2, slice(30, N)), KNEE, 0.2, slice(30, N))
    assert "but for left wrist and right knee" in to_the_end.verdict().message


def turned(degrees):
    """Poses of a walker with another heading."""
    poses = walk().copy()
    poses[:, 3] += np.radians(degrees)
    return poses


@pytest.mark.parametrize(("degrees", "is_reported"), [(58.0, False), (62.0, True)])
def test_landmarks_that_face_elsewhere_contradict_the_torso(degrees, is_reported):
    upright = walk().copy()
    upright[:, 4:6] = 0.0
    poses = upright.copy()
    poses[:, 3] += np.radians(degrees)
    verdict = with_landmarks(replace(ONE, poses=upright), poses, slice(20, 40)).verdict()
    assert ("direction of the torso" in kinds(verdict)) == is_reported
    assert (verdict.joint_states["torso"][30] == DOUBTFUL) == is_reported
    assert verdict.joint_states["torso"][50] == "tracked"


@pytest.mark.parametrize(("n", "level"), [(12, TRUSTWORTHY), (13, DOUBTFUL), (20, DOUBTFUL), (21, NOT_USABLE)])
def test_a_contradiction_lasts_and_weighs_by_its_share_of_the_clip(n, level):
    """Half a second are 13 frames at 25 Hz, and a third of the clip 20."""
    verdict = with_landmarks(ONE, turned(180.0), slice(20, 20 + n)).verdict()
    assert verdict.level == level, verdict.message


@pytest.mark.parametrize(("degrees", "is_reported"), [(43.0, False), (47.0, True)])
def test_landmarks_with_another_flexion_contradict_a_knee(degrees, is_reported):
    knee = BODY.skeleton.dof("right_knee_flexion")
    poses = walk().copy()
    poses[:, knee] += np.radians(degrees)
    verdict = with_landmarks(ONE, poses, slice(20, 40)).verdict()
    assert ("bent knees" in kinds(verdict)) == is_reported
    assert (verdict.joint_states["right_leg"][30] == DOUBTFUL) == is_reported
    assert verdict.joint_states["left_leg"][30] == "tracked"


def test_landmarks_that_agree_have_no_finding_in_any_number_of_cameras():
    for intact in (ONE, FOUR):
        assert with_landmarks(intact).verdict().level == TRUSTWORTHY


@pytest.mark.parametrize(("error_m", "state"), [(0.149, "tracked"), (0.151, DOUBTFUL), (0.301, "lost")])
def test_true_positions_decide_where_they_are_known(error_m, state):
    truth = replace(ONE, truth_m=np.zeros((N, 3)), errors={"mpjpe_abs_mm": np.full(N, 20.0)}).measurements()
    truth.joint_errors_m[LATE, WRIST] = error_m
    states = joint_states(truth)
    assert (states.of_joints(("left_wrist",))[30], states.of_joints(("right_wrist",))[30]) == (state, "tracked")


@pytest.mark.parametrize(("error_m", "state"), [(0.449, "tracked"), (0.451, DOUBTFUL)])
def test_a_joint_with_a_large_expected_error_is_doubtful(error_m, state):
    measured = ONE.measurements()
    assert (measured.expected_joint_errors_m[:, WRIST] < 0.1).all()
    measured.expected_joint_errors_m[LATE, WRIST] = error_m
    assert joint_states(measured).of_joints(("left_elbow", "left_wrist"))[30] == state


def test_annotations_decide_in_their_frames():
    annotations = np.full((N, 15, 2), np.nan)
    annotations[[10, 30]] = ONE.keypoints[0, [10, 30], :, :2]
    annotations[30, WRIST, 0] += 0.15 * np.ptp(annotations[30, :, 1])
    errors = {
        "mpjpe_px": np.where(np.isfinite(annotations[:, 0, 0]), 1.0, np.nan),
        "forearm_width_px": np.full(N, 20.0),
    }
    verdict = replace(ONE, annotations=annotations, errors=errors).verdict()
    assert [t for t, state in enumerate(verdict.joint_states["left_arm"]) if state == "lost"] == [30]
    assert "from its annotations in frame 30" in verdict.message


def test_states_without_observations_are_unknown():
    nothing = replace(ONE, keypoints=np.full_like(ONE.keypoints, np.nan))
    assert nothing.verdict().joint_states == {}
    keypoints = ONE.keypoints.copy()
    keypoints[:, 30:] = np.nan
    assert replace(ONE, keypoints=keypoints).verdict().joint_states["torso"][29:31] == ["tracked", "not known"]


def test_stretches_bridge_confusions_only():
    times_s = np.arange(20) / 10.0
    chosen = np.isin(np.arange(20), [2, 3, 5, 9, 10])
    assert stretches(chosen, times_s) == [(2, 5), (9, 10)]
    assert stretches(np.zeros(20, bool), times_s) == []
    assert lasting(np.isin(np.arange(20), range(3, 8)), times_s).sum() == 5
    assert lasting(np.isin(np.arange(20), range(3, 7)), times_s).sum() == 0


def test_a_running_median_ignores_frames_without_a_value():
    values = np.array([1.0, np.nan, 9.0, 1.0, 1.0, np.nan])[:, None]
    np.testing.assert_array_equal(running_median(values, 3)[:, 0], [1.0, np.nan, 1.0, 1.0, 1.0, np.nan])


@pytest.mark.parametrize(("n_lost", "is_lost"), [(6, False), (7, True)])
def test_the_body_is_lost_with_half_of_14_joints(n_lost, is_lost):
    measured = ONE.measurements()
    measured.keypoint_distances_px[:, :, 1 : 1 + n_lost] = 0.2 * measured.person_height_px[..., None]
    measured.observed.keypoints[:, :, 0] = np.nan
    states = joint_states(measured)
    assert (states.seen.sum(axis=1) == 14).all()
    assert (states.body_lost == is_lost).all()


@pytest.mark.parametrize("intact", [ONE, FOUR], ids=["one camera", "four cameras"])
@pytest.mark.parametrize(("n", "is_lost"), [(6, False), (7, True)])
def test_a_person_is_lost_in_frozen_frames(intact, n, is_lost):
    """A quarter of a second are 6.25 frames."""
    keypoints = intact.keypoints.copy()
    keypoints[:, 20 : 20 + n] = keypoints[:, 19:20]
    states = replace(intact, keypoints=keypoints).verdict().states
    assert (set(states[20 : 20 + n]) == {"lost"}) == is_lost
    assert set(states[:20]) | set(states[20 + n :]) == {"tracked"}


def test_a_person_is_not_lost_where_one_of_four_cameras_is_frozen():
    keypoints = FOUR.keypoints.copy()
    keypoints[:1, 20:] = keypoints[:1, 19:20]
    assert not joint_states(replace(FOUR, keypoints=keypoints).measurements()).body_lost.any()


@pytest.mark.parametrize(("last", "later"), [(N, "lost"), (45, "tracked")])
def test_a_person_is_lost_while_another_one_is_followed(last, later):
    measured = ONE.measurements()
    keypoints = ONE.keypoints.copy()
    feet = keypoints[:, 25:last, [11, 14], :2].mean(axis=2, keepdims=True)
    keypoints[:, 25:last, :, :2] = feet + 0.6 * (keypoints[:, 25:last, :, :2] - feet)
    distances = measured.keypoint_distances_px
    measured = replace(replace(ONE, keypoints=keypoints).measurements(), keypoint_distances_px=distances)
    lost = joint_states(measured).body_lost
    assert (lost[:20].any(), lost[30:40].all()) == (False, True)
    assert lost[last + 5 :].any() == (later == "lost" and last + 5 < N)
