"""Tracking of several people over views, selection of the target, and correction of left/right labels."""

import logging
from itertools import product

import numpy as np
import pytest
from crowd_scenes import CAMERAS, RATE_HZ, crowd, identities, projections, walkers
from openpose_scenes import people_in, points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.association.assignment import Tracks
from workbench.detections.association.detector_view import DetectorView
from workbench.detections.association.keypoint_kalman import LEGS
from workbench.detections.association.left_right import (
    PARTS,
    _cheapest,
    _cost,
    _twist_costs,
    exchanged_labels,
    with_corrected_labels,
)
from workbench.detections.association.target_selection import select_target
from workbench.detections.association.track_stitching import stitched, without_short
from workbench.detections.readers.people import People
from workbench.utils.errors import InputError

CROSSING = (((-0.8, -0.2), (1.6, 0.0)), ((0.8, 0.2), (-1.6, 0.0)))
"""Two people who pass each other at 40 cm, half a second after the first frame."""


def scene(seed, paths=CROSSING, cameras=CAMERAS, n_frames=30, **options):
    rng = np.random.default_rng(seed)
    return crowd(cameras, projections(cameras, walkers(paths, n_frames), rng), rng, **options)


def first_detections(scene, name):
    """Return the people (n,) in the first frame in which a camera detects one."""
    return next(people for people in scene.owners[name] if len(people))


def target(scene, person):
    """Select a person by the index in the first camera that detects this person in its first frame with people."""
    name = next(name for name in scene.cameras if person in first_detections(scene, name))
    index = int(np.flatnonzero(first_detections(scene, name) == person)[0])
    return select_target(scene.people, scene.cameras, RATE_HZ, {name: index})


@pytest.mark.parametrize("seed", range(2))
def test_two_people_who_cross_are_distinguished(seed):
    crossing = scene(seed)
    for person in range(2):
        selected = target(crossing, person)
        owner, visible = identities(crossing, selected)
        assert set(owner.ravel().tolist()) <= {-1, person}
        in_two_views = visible[:, :, person].sum(axis=1) >= 2
        assert (owner == person).any(axis=0)[in_two_views].mean() >= 0.95
        assert selected.counts["people"] == 2


def test_a_person_who_leaves_and_returns_has_one_track(caplog):
    crossing = scene(0, missing=0.0, n_frames=70)
    for name in crossing.people:  # the second person is absent for longer than a gap that is bridged
        for t in range(14, 58):
            first_person = crossing.owners[name][t] == 0
            crossing.owners[name][t] = crossing.owners[name][t][first_person]
            rows = list(crossing.people[name].joints)
            rows[t] = rows[t][first_person]
            crossing.people[name] = People(name, "COCO_17", crossing.people[name].frames, tuple(rows))
    with caplog.at_level(logging.INFO):
        selected = target(crossing, 1)
    owner, _ = identities(crossing, selected)
    assert set(owner.ravel().tolist()) == {-1, 1}
    tracked = (owner == 1).any(axis=0)
    assert tracked[:14].all()
    assert not tracked[14:58].any()
    assert tracked[60:].mean() > 0.6  # a track begins with detections in two views
    assert selected.counts["people"] == 2
    assert "left: the target is not detected in frames 14 to" in caplog.text


def test_exchanged_sides_are_corrected_and_counted(caplog):
    rng = np.random.default_rng(3)
    correct = projections(CAMERAS, walkers(CROSSING[:1], 40), rng)
    exchanged = crowd(CAMERAS, correct, rng, missing=0.0, lost_joints=0.0, swapped=0.15)
    n_swapped = sum(int(swaps.sum()) for swaps_of_view in exchanged.swapped.values() for swaps in swaps_of_view)
    assert n_swapped > 10
    with caplog.at_level(logging.INFO):
        selected = target(exchanged, 0)
    for view, name in enumerate(CAMERAS):
        np.testing.assert_array_equal(selected.joints[view], correct[name][0])
    assert selected.counts["swapped_sides"] == n_swapped
    assert "left and right labels of" in caplog.text


def test_a_single_camera_tracks_people_in_the_image(tmp_path):
    paths = [(100.0, 8.0, 0.6), (400.0, -8.0, 0.9)]  # two people pass each other in about ten frames
    frames = {}
    for t in range(30):
        two = [points("COCO_17", standing(u + v * t, 100.0 + 60.0 * k, 200.0), c) for k, (u, v, c) in enumerate(paths)]
        frames[t] = two[:: -1 if t % 3 else 1]
    del frames[14][0]
    people = {"one": people_in(write(tmp_path, frames))}
    head = JOINT_NAMES.index("head_centre")
    for person, (u, v, _) in enumerate(paths):
        heads = select_target(people, None, RATE_HZ, person).joints[0, :, head, 0]
        detected = np.isfinite(heads)
        assert detected.sum() >= 29
        np.testing.assert_allclose(heads[detected], (u + v * np.arange(30.0))[detected])
    np.testing.assert_allclose(select_target(people, None, RATE_HZ).joints[0, 0, head, 0], 400.0)  # highest confidence


def test_the_order_of_people_and_empty_detections_do_not_matter():
    crossing, empty = scene(5, n_frames=15), np.full((1, 15, 3), np.nan)  # OpenPose also writes people without joints

    def changed(change):
        return {n: People(n, "COCO_17", p.frames, tuple(map(change, p.joints))) for n, p in crossing.people.items()}

    expected = select_target(crossing.people, crossing.cameras, RATE_HZ)
    padded = changed(lambda rows: np.concatenate([empty, rows]))
    for people in (changed(lambda rows: rows[::-1]), padded):
        np.testing.assert_array_equal(select_target(people, crossing.cameras, RATE_HZ).joints, expected.joints)
    with pytest.raises(InputError, match="person 0 in frame 0 cannot be tracked"):
        select_target(padded, crossing.cameras, RATE_HZ, {"front": 0})
    with pytest.raises(InputError, match="no person 2, expected 0 to 1"):
        select_target(padded, crossing.cameras, RATE_HZ, 2)


def test_rays_that_do_not_intersect_are_an_error():
    single = scene(0, CROSSING[:1], missing=0.0)
    rng = np.random.default_rng(1)
    elevated = [joints + np.array([0.0, 0.0, 1.0]) for joints in walkers(CROSSING[1:])]
    other = crowd(CAMERAS, projections(CAMERAS, elevated, rng), rng, missing=0.0)
    inconsistent = {"front": single.people["front"], "left": other.people["left"]}
    with pytest.raises(InputError, match="front, left: expected a person in two cameras at once"):
        select_target(inconsistent, single.cameras, RATE_HZ)
    undetected = {**single.people, "front": People("front", "COCO_17", np.array([0]), (np.empty((0, 15, 3)),))}
    with pytest.raises(InputError, match="front: no person 0: no person is detected in the frames used"):
        select_target(undetected, single.cameras, RATE_HZ, {"front": 0})


def stitched_people(*spans, n_frames=90):
    """Return the people of separate tracks of standing bodies after stitching, None for a removed track.

    spans : (body (J, 3), first frame, last frame).
    """
    assigned, joints = [{} for _ in range(n_frames)], [{} for _ in range(n_frames)]
    for number, (body, first, last) in enumerate(spans):
        for t in range(first, last + 1):
            assigned[t][0, number] = number
            joints[t][number] = body
    tracks = Tracks(tuple(assigned), tuple(joints), np.full(n_frames, np.inf))
    people = stitched(without_short(tracks), np.arange(n_frames) / RATE_HZ)
    return [people[first].get((0, number)) for number, (_, first, _) in enumerate(spans)]


SMALL, _, TALL = (joints[0] for joints in walkers([((0.0, 0.0), (1.0, 0.0))] * 3, 1))  # 1.65 m and 1.85 m


ASIDE = np.array([0.5, 0.0, 0.0])


@pytest.mark.parametrize(
    ("spans", "people"),
    [
        pytest.param([(SMALL, 0, 30), (SMALL + 0.3, 60, 80)], [0, 0], id="nearby"),
        pytest.param([(SMALL, 0, 30), (SMALL + 10.0 * ASIDE, 40, 80)], [0, 1], id="distant"),
        pytest.param(
            [(SMALL, 0, 30), (TALL + ASIDE, 0, 30), (TALL + 0.5 * ASIDE, 60, 80), (SMALL + 0.5 * ASIDE, 60, 80)],
            [0, 1, 1, 0], id="two people of different limbs",
        ),
        pytest.param([(SMALL, 0, 60), (SMALL + 0.2, 40, 80)], [0, 1], id="at the same time"),
        pytest.param([(SMALL, 0, 60), (SMALL + 1.0, 20, 21)], [0, None], id="a short track"),
        pytest.param([(SMALL, 3, 3)], [0], id="only a short track"),
    ],
)  # fmt: skip
def test_tracks_of_one_person_are_stitched(spans, people):
    assert stitched_people(*spans) == people


ALL_JOINTS = np.ones(15, dtype=bool)


def detected_walker(names, n_frames=40):
    """Return the views and the detections (V, T, J, 3) of a walker; a single view has no calibration."""
    detections = projections(
        {name: CAMERAS[name] for name in names}, walkers(CROSSING[:1], n_frames), np.random.default_rng(0)
    )
    calibrated = len(names) > 1
    views = [
        DetectorView(CAMERAS[name] if calibrated else None, ALL_JOINTS, 1.0 if calibrated else 300.0) for name in names
    ]
    return views, np.array([detections[name][0] for name in names])


@pytest.mark.parametrize("names", [["left"], ["front", "left"], list(CAMERAS)])
@pytest.mark.parametrize("frames", [slice(7, 8), slice(12, 20), slice(0, 5), slice(36, 40)])
def test_exchanged_labels_are_detected(names, frames):
    views, joints = detected_walker(names)
    swapped = np.zeros((len(names), 40, len(PARTS)), dtype=bool)
    swapped[0, frames] = True
    swapped[-1, 25:28, 1] = True
    estimated = exchanged_labels(views, with_corrected_labels(joints, swapped), RATE_HZ)
    np.testing.assert_array_equal(estimated, swapped)
    np.testing.assert_array_equal(with_corrected_labels(with_corrected_labels(joints, swapped), estimated), joints)


@pytest.mark.parametrize(
    ("twist_deg", "expected"), [(89.0, [False, False, True, False]), (91.0, [True, False, False, True])]
)
def test_shoulders_turned_from_the_hips_by_over_a_right_angle_are_a_cost(twist_deg, expected):
    """Of the states none, legs, arms, both exchanged."""
    joints, angle = np.full((2, len(JOINT_NAMES), 6), np.nan), np.radians(twist_deg)
    for joint, across in (("shoulder", [np.cos(angle), 0.0, np.sin(angle)]), ("hip", [1.0, 0.0, 0.0])):
        for side, sign in (("left", 0.2), ("right", -0.2)):
            joints[0, JOINT_NAMES.index(f"{side}_{joint}"), 3:] = sign * np.array(across)
    costs = _twist_costs(joints)
    assert (costs[0, 0, 0] > 0.0).tolist() == expected
    assert not costs[1].any()
    assert not _twist_costs(joints[..., :3]).any()


def test_the_cheapest_path_is_that_of_enumeration():
    rng = np.random.default_rng(0)
    for _ in range(5):
        costs = 3.0 * rng.random((5, 4, 4, 4))
        paths = [np.array(path) for path in product(range(4), repeat=5)]
        np.testing.assert_array_equal(_cheapest(costs), min(paths, key=lambda path: _cost(costs, path)))


def test_arms_resolve_an_ambiguous_labelling_of_the_legs():
    """The legs coincide before and after the exchanged frames, so that their motion does not determine the labels."""
    view, rng, n = DetectorView(None, np.ones(len(JOINT_NAMES), bool)), np.random.default_rng(0), 40
    joints = np.full((1, n, len(JOINT_NAMES), 3), np.nan)
    for part, limb in enumerate(PARTS):
        for j, name in enumerate(JOINT_NAMES):
            if name.split("_")[-1] in limb:
                joints[0, :, j] = [0.4 if name.startswith("left") else -0.4, 0.1 * j + part, 1.0]
                joints[0, :, j, :2] += rng.normal(0.0, 0.01, (n, 2))
                if part == PARTS.index(LEGS):
                    joints[0, [10, 11, 12, 28, 29, 30], j, 0] = 0.0
    swapped = np.zeros((1, n, len(PARTS)), bool)
    swapped[0, [13, 14, 15, 17, 18, 20, 21, 22, 24, 25, 27]] = True
    estimated = exchanged_labels([view], with_corrected_labels(joints, swapped), 60.0)
    np.testing.assert_array_equal(estimated, swapped)
