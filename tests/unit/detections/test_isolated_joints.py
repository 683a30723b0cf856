"""Joints that a detector puts elsewhere for a few frames, and the thresholds of their removal on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import camera_arc, walker_joints
from openpose_scenes import people_in, points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.image_height import height_px
from workbench.detections.association.isolated_joints import isolated_joints, without_isolated
from workbench.detections.association.target_selection import select_target

N, RATE_HZ = 20, 30.0
FRAMES = np.arange(N)
WRIST = JOINT_NAMES.index("left_wrist")


def standing_walker(away_px=0.0):
    """Return joints (1, N, J, 3) of a person who stands still, whose left wrist is away in one frame."""
    joints = np.repeat(walker()[:, :1], N, axis=1)
    joints[0, 7, WRIST, 0] += away_px
    return joints


def walker():
    """Return a walker's joints (1, N, J, 3) in one camera."""
    (camera,) = camera_arc(1)
    pixels = camera.project(walker_joints())[None]
    return np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)


def test_a_walk_has_no_isolated_joints():
    assert not isolated_joints(walker(), FRAMES, RATE_HZ).any()


@pytest.mark.parametrize(("away", "is_isolated"), [(0.48, False), (0.52, True)])
def test_a_joint_is_isolated_from_half_the_height_on(away, is_isolated):
    isolated = isolated_joints(standing_walker(away * height_px(walker()[0, 0, :, :2])), FRAMES, RATE_HZ)
    assert isolated[0, 7, WRIST] == is_isolated
    assert isolated.sum() == is_isolated


@pytest.mark.parametrize(
    ("rate_hz", "step", "is_isolated"), [(9.9, 1, False), (10.0, 1, True), (RATE_HZ, 3, True), (RATE_HZ, 10, False)]
)
def test_frames_far_apart_are_no_neighbours(rate_hz, step, is_isolated):
    assert isolated_joints(standing_walker(1000.0), step * FRAMES, rate_hz).any() == is_isolated


@pytest.mark.parametrize(("n_missing", "is_isolated"), [(4, True), (5, False)])
def test_three_places_determine_a_path(n_missing, is_isolated):
    """At 30 Hz the window is of seven frames."""
    joints = standing_walker(1000.0)
    joints[0, [4, 5, 6, 8, 9][:n_missing], WRIST] = np.nan
    assert isolated_joints(joints, FRAMES, RATE_HZ)[0, 7, WRIST] == is_isolated


def test_exchanged_labels_of_spread_arms_are_not_removed():
    joints = standing_walker()
    left, right = WRIST, JOINT_NAMES.index("right_wrist")
    height = height_px(joints[0, 0, :, :2])
    joints[0, :, left, 0], joints[0, :, right, 0] = 500.0 + 0.5 * height, 500.0 - 0.5 * height
    joints[0, 7, [left, right]] = joints[0, 7, [right, left]]
    assert not isolated_joints(joints, FRAMES, RATE_HZ).any()


def test_a_person_who_jumps_for_good_is_not_removed():
    joints = standing_walker()
    joints[0, 10:, :, 0] += 1000.0
    assert not isolated_joints(joints, FRAMES, RATE_HZ)[0, 3:-3].any()


def test_the_target_has_no_isolated_joints(tmp_path):
    frames = {t: [points("BODY_25B", standing(200.0, 100.0 + t))] for t in range(N)}
    wrong = points("BODY_25B", standing(200.0, 109.0) | {"left_wrist": (600.0, 400.0)})
    people = people_in(write(tmp_path, frames | {9: [wrong]}))
    target = select_target({"": people}, None, RATE_HZ)
    assert np.isnan(target.joints[0, 9, WRIST]).all()
    assert np.isfinite(target.joints[0, [8, 10], WRIST, :3]).all()
    assert np.isnan(without_isolated(people, RATE_HZ).joints[9][0, WRIST]).all()


def test_several_people_of_a_view_are_not_told_apart(tmp_path):
    frames = {t: [points("BODY_25B", standing(200.0, 100.0)), points("BODY_25B", standing(500.0, 100.0))]
              for t in range(N)}  # fmt: skip
    people = people_in(write(tmp_path, frames))
    assert without_isolated(people, RATE_HZ) is people
    nobody = replace(people, joints=tuple(rows[:0] for rows in people.joints))
    assert without_isolated(nobody, RATE_HZ) is nobody
