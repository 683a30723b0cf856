"""Who is who: people cross, are hidden, leave and come back; left and right are put right again."""

import logging
from itertools import product

import numpy as np
import pytest
from crowd_scenes import CAMERAS, RATE_HZ, crowd, identities, projections, walkers
from openpose_scenes import points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.assignment import Tracks
from workbench.datasets.association.detections import DetectorView
from workbench.datasets.association.keypoint_kalman import LEGS
from workbench.datasets.association.left_right import PARTS, _cheapest, _cost, exchanged_labels, with_corrected_labels
from workbench.datasets.association.target_selection import select_target
from workbench.datasets.association.track_stitching import stitched, without_short
from workbench.motion.formats.openpose import People, read_openpose
from workbench.utils.errors import InputError

CROSSING = (((-0.8, -0.2), (1.6, 0.0)), ((0.8, 0.2), (-1.6, 0.0)))
"""Two who pass each other at 40 cm, half a second after the first frame."""


def scene(seed, ways=CROSSING, cameras=CAMERAS, n_frames=30, **given):
    rng = np.random.default_rng(seed)
    return crowd(cameras, projections(cameras, walkers(ways, n_frames), rng), rng, **given)


def first_row(made, name, who):
    """The number of somebody in the first frame in which a camera shows anybody."""
    order = next(order for order in made.owners[name] if len(order))
    return int(np.flatnonzero(order == who)[0])


def followed(made, who):
    name = next(name for name in made.cameras if who in next(order for order in made.owners[name] if len(order)))
    return select_target(made.people, made.cameras, RATE_HZ, {name: first_row(made, name, who)})


@pytest.mark.parametrize("seed", range(2))
def test_two_who_cross_are_told_apart(seed):
    made = scene(seed)
    for who in range(2):
        found = followed(made, who)
        owner, there = identities(made, found)
        assert set(owner.ravel().tolist()) <= {-1, who}  # no frame of two people, none of the other one
        shown_twice = there[:, :, who].sum(axis=1) >= 2
        assert (owner == who).any(axis=0)[shown_twice].mean() >= 0.95
        assert found.counts["people"] == 2


def test_without_others_every_joint_is_kept():
    made = scene(0, CROSSING[:1], missing=0.0)
    found = followed(made, 0)
    for view, name in enumerate(made.cameras):
        np.testing.assert_array_equal(found.joints[view], [rows[0] for rows in made.people[name].joints])
    assert found.counts == {"people": 1, "frames_unseen": 0, "swapped_sides": 0}


def test_who_leaves_and_comes_back_is_the_same(caplog):
    made = scene(0, missing=0.0, n_frames=70)
    for name in made.people:  # the second leaves for longer than a gap that is bridged
        for t in range(14, 58):
            keep = made.owners[name][t] == 0
            made.owners[name][t] = made.owners[name][t][keep]
            rows = list(made.people[name].joints)
            rows[t] = rows[t][keep]
            made.people[name] = People(name, "COCO_17", made.people[name].frames, tuple(rows))
    with caplog.at_level(logging.INFO):
        found = followed(made, 1)
    owner, _ = identities(made, found)
    assert set(owner.ravel().tolist()) == {-1, 1}
    seen = (owner == 1).any(axis=0)
    assert seen[:14].all()
    assert not seen[14:58].any()
    assert seen[60:].mean() > 0.6  # two views at once make sure who it is
    assert found.counts["people"] == 2
    assert "left: the target is not detected in frames 14 to" in caplog.text


def test_exchanged_sides_are_put_right_and_counted(caplog):
    rng = np.random.default_rng(3)
    right = projections(CAMERAS, walkers(CROSSING[:1], 40), rng)
    made = crowd(CAMERAS, right, rng, missing=0.0, lost_joints=0.0, swapped=0.15)
    n_swapped = sum(int(parts.sum()) for parts_of in made.swapped.values() for parts in parts_of)
    assert n_swapped > 10
    with caplog.at_level(logging.INFO):
        found = followed(made, 0)
    for view, name in enumerate(CAMERAS):
        np.testing.assert_array_equal(found.joints[view], right[name][0])
    assert found.counts["swapped_sides"] == n_swapped
    assert "left and right labels of" in caplog.text


def test_by_one_camera_people_are_followed_in_the_image(tmp_path):
    ways = [(100.0, 8.0, 0.6), (400.0, -8.0, 0.9)]  # who pass each other, in reach of each other for ten frames
    frames = {}
    for t in range(30):
        two = [points("COCO_17", standing(u + v * t, 100.0 + 60.0 * k, 200.0), c) for k, (u, v, c) in enumerate(ways)]
        frames[t] = two[:: -1 if t % 3 else 1]
    del frames[14][0]
    people = {"one": read_openpose(write(tmp_path, frames))}
    head = JOINT_NAMES.index("head_centre")
    for person, (u, v, _) in enumerate(ways):
        heads = select_target(people, None, RATE_HZ, person).joints[0, :, head, 0]
        seen = np.isfinite(heads)
        assert seen.sum() >= 29
        np.testing.assert_allclose(heads[seen], (u + v * np.arange(30.0))[seen])
    np.testing.assert_allclose(select_target(people, None, RATE_HZ).joints[0, 0, head, 0], 400.0)  # the surest


def test_neither_the_order_of_people_nor_empty_ones_among_them_matter():
    made, nothing = scene(5), np.full((1, 15, 3), np.nan)  # as OpenPose writes them, at any place among the others

    def changed(change):
        return {n: People(n, "COCO_17", p.frames, tuple(map(change, p.joints))) for n, p in made.people.items()}

    plain = select_target(made.people, made.cameras, RATE_HZ)
    padded = changed(lambda rows: np.concatenate([nothing, rows]))
    for people in (changed(lambda rows: rows[::-1]), padded):
        np.testing.assert_array_equal(select_target(people, made.cameras, RATE_HZ).joints, plain.joints)
    with pytest.raises(InputError, match="person 0 in frame 0 cannot be tracked"):
        select_target(padded, made.cameras, RATE_HZ, 0)


def test_people_whose_rays_do_not_meet_are_refused():
    made = scene(0, CROSSING[:1], missing=0.0)
    rng = np.random.default_rng(1)
    upstairs = [one + np.array([0.0, 0.0, 1.0]) for one in walkers(CROSSING[1:])]
    other = crowd(CAMERAS, projections(CAMERAS, upstairs, rng), rng, missing=0.0)
    apart = {"front": made.people["front"], "left": other.people["left"]}
    with pytest.raises(InputError, match="front, left: expected a person in two cameras at once"):
        select_target(apart, made.cameras, RATE_HZ)
    alone = {**made.people, "front": People("front", "COCO_17", np.array([0]), (np.empty((0, 15, 3)),))}
    with pytest.raises(InputError, match="front: no person 0: no person is detected in the frames used"):
        select_target(alone, made.cameras, RATE_HZ, {"front": 0})


def tracks(*spans, n_frames=90):
    """Of people who stand, (body (J, 3), first frame, last frame), each a track of its own."""
    assigned, joints = [{} for _ in range(n_frames)], [{} for _ in range(n_frames)]
    for number, (body, first, last) in enumerate(spans):
        for t in range(first, last + 1):
            assigned[t][0, number] = number
            joints[t][number] = body
    return Tracks(tuple(assigned), tuple(joints), np.full(n_frames, np.inf)), np.arange(n_frames) / RATE_HZ


def who(*spans):
    """Whose the tracks turn out to be, None for nobody's."""
    tracked, times_s = tracks(*spans)
    found = stitched(without_short(tracked), times_s)
    return [found[first].get((0, number)) for number, (_, first, _) in enumerate(spans)]


SMALL, _, TALL = (one[0] for one in walkers([((0.0, 0.0), (1.0, 0.0))] * 3, 1))  # 1.65 m and 1.85 m


def test_who_comes_back_nearby_is_the_same_and_who_comes_far_off_at_once_is_not():
    assert who((SMALL, 0, 30), (SMALL + 0.3, 60, 80)) == [0, 0]
    assert who((SMALL, 0, 30), (SMALL + np.array([5.0, 0.0, 0.0]), 40, 80)) == [0, 1]


def test_of_two_who_left_each_comes_back_as_themselves():
    aside = np.array([0.4, 0.0, 0.0])
    spans = ((SMALL, 0, 30), (TALL + aside, 0, 30), (TALL + 0.5 * aside, 60, 80), (SMALL + 0.5 * aside, 60, 80))
    assert who(*spans) == [0, 1, 1, 0]


def test_who_is_there_at_the_same_time_is_somebody_else():
    assert who((SMALL, 0, 60), (SMALL + 0.2, 40, 80)) == [0, 1]


def test_who_is_hardly_seen_is_nobody():
    assert who((SMALL, 0, 60), (SMALL + 1.0, 20, 21)) == [0, None]
    assert who((SMALL, 3, 3)) == [0]


WALK = (((-0.8, -0.2), (1.6, 0.0)),)
ALL = np.ones(15, dtype=bool)


def seen(names, n_frames=40, seed=0):
    """Eyes and (V, T, J, 3) of a walker."""
    found = projections({name: CAMERAS[name] for name in names}, walkers(WALK, n_frames), np.random.default_rng(seed))
    eyes = [
        DetectorView(CAMERAS[name] if len(names) > 1 else None, ALL, 1.0 if len(names) > 1 else 300.0) for name in names
    ]
    return eyes, np.array([found[name][0] for name in names])


@pytest.mark.parametrize("names", [["left"], ["front", "left"], list(CAMERAS)])
def test_nothing_is_exchanged_where_nothing_was(names):
    eyes, joints = seen(names)
    assert not exchanged_labels(eyes, joints, RATE_HZ).any()


@pytest.mark.parametrize("names", [["left"], ["front", "left"], list(CAMERAS)])
@pytest.mark.parametrize("frames", [slice(7, 8), slice(12, 20), slice(0, 5), slice(36, 40)])  # arms apart
def test_what_was_exchanged_is_found(names, frames):
    eyes, joints = seen(names)
    swapped = np.zeros((len(names), 40, len(PARTS)), dtype=bool)
    swapped[0, frames] = True
    swapped[-1, 25:28, 1] = True
    found = exchanged_labels(eyes, with_corrected_labels(joints, swapped), RATE_HZ)
    np.testing.assert_array_equal(found, swapped)
    np.testing.assert_array_equal(with_corrected_labels(with_corrected_labels(joints, swapped), found), joints)


def test_the_path_is_the_cheapest_of_all():
    rng = np.random.default_rng(0)
    for _ in range(5):
        costs = 3.0 * rng.random((5, 4, 4, 4))
        paths = [np.array(path) for path in product(range(4), repeat=5)]
        best = min(paths, key=lambda path: _cost(costs, path))
        np.testing.assert_array_equal(_cheapest(costs), best)


def test_arms_decide_which_of_two_labellings_of_the_legs_is_right():
    """The legs coincide before and after frames most of which are exchanged, so that their own motion cannot decide."""
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
    found = exchanged_labels([view], with_corrected_labels(joints, swapped), 60.0)
    np.testing.assert_array_equal(found, swapped)
