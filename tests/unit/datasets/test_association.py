"""Who is who: people cross, are hidden, leave and come back, and every frame's joints are still one person's."""

import logging

import numpy as np
import pytest
from crowd_scenes import CAMERAS, RATE_HZ, crowd, shown, walkers, whose
from openpose_scenes import points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.target_selection import follow
from workbench.motion.formats.openpose import People, read_openpose
from workbench.utils.errors import InputError

CROSSING = (((-0.8, -0.2), (1.6, 0.0)), ((0.8, 0.2), (-1.6, 0.0)))
"""Two who pass each other at 40 cm, half a second after the first frame."""


def scene(seed, ways=CROSSING, cameras=CAMERAS, n_frames=30, **given):
    rng = np.random.default_rng(seed)
    return crowd(cameras, shown(cameras, walkers(ways, n_frames), rng), rng, **given)


def first_row(made, name, who):
    """The number of somebody in the first frame in which a camera shows anybody."""
    order = next(order for order in made.owners[name] if len(order))
    return int(np.flatnonzero(order == who)[0])


def followed(made, who):
    name = next(name for name in made.cameras if who in next(order for order in made.owners[name] if len(order)))
    return follow(made.people, made.cameras, RATE_HZ, {name: first_row(made, name, who)})


@pytest.mark.parametrize("seed", range(2))
def test_two_who_cross_are_told_apart(seed):
    made = scene(seed)
    for who in range(2):
        found = followed(made, who)
        owner, there = whose(made, found)
        assert set(owner.ravel().tolist()) <= {-1, who}  # no frame of two people, none of the other one
        shown_twice = there[:, :, who].sum(axis=1) >= 2
        assert (owner == who).any(axis=0)[shown_twice].mean() >= 0.95
        assert found.counted["people"] == 2


def test_without_others_every_joint_is_kept():
    made = scene(0, CROSSING[:1], missing=0.0)
    found = followed(made, 0)
    for view, name in enumerate(made.cameras):
        np.testing.assert_array_equal(found.joints[view], [rows[0] for rows in made.people[name].joints])
    assert found.counted == {"people": 1, "frames_unseen": 0, "swapped_sides": 0}


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
    owner, _ = whose(made, found)
    assert set(owner.ravel().tolist()) == {-1, 1}
    seen = (owner == 1).any(axis=0)
    assert seen[:14].all()
    assert not seen[14:58].any()
    assert seen[60:].mean() > 0.6  # two views at once make sure who it is
    assert found.counted["people"] == 2
    assert "left: the person is not found in frames 14 to" in caplog.text


def test_exchanged_sides_are_put_right_and_counted(caplog):
    rng = np.random.default_rng(3)
    right = shown(CAMERAS, walkers(CROSSING[:1], 40), rng)
    made = crowd(CAMERAS, right, rng, missing=0.0, lost_joints=0.0, swapped=0.15)
    n_swapped = sum(int(parts.sum()) for parts_of in made.swapped.values() for parts in parts_of)
    assert n_swapped > 10
    with caplog.at_level(logging.INFO):
        found = followed(made, 0)
    for view, name in enumerate(CAMERAS):
        np.testing.assert_array_equal(found.joints[view], right[name][0])
    assert found.counted["swapped_sides"] == n_swapped
    assert "were exchanged" in caplog.text


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
        heads = follow(people, None, RATE_HZ, person).joints[0, :, head, 0]
        seen = np.isfinite(heads)
        assert seen.sum() >= 29
        np.testing.assert_allclose(heads[seen], (u + v * np.arange(30.0))[seen])
    np.testing.assert_allclose(follow(people, None, RATE_HZ).joints[0, 0, head, 0], 400.0)  # the surest


def test_the_same_people_in_another_order_are_the_same():
    made = scene(5)
    turned = {
        name: People(name, "COCO_17", people.frames, tuple(rows[::-1] for rows in people.joints))
        for name, people in made.people.items()
    }
    one, other = follow(made.people, made.cameras, RATE_HZ), follow(turned, made.cameras, RATE_HZ)
    np.testing.assert_array_equal(one.joints, other.joints)


def test_empty_people_are_nobody():
    """As OpenPose writes them, at any place among the others."""
    made = scene(6)
    nothing = np.full((1, 15, 3), np.nan)
    padded = {
        name: People(name, "COCO_17", people.frames, tuple(np.concatenate([nothing, rows]) for rows in people.joints))
        for name, people in made.people.items()
    }
    plain = follow(made.people, made.cameras, RATE_HZ)
    np.testing.assert_array_equal(follow(padded, made.cameras, RATE_HZ).joints, plain.joints)
    with pytest.raises(InputError, match="person 0 in frame 0 cannot be followed"):
        follow(padded, made.cameras, RATE_HZ, 0)


def test_who_is_seen_by_one_camera_at_first_is_followed_from_there():
    made = scene(7, missing=0.0)
    for name in ("left", "back"):
        rows = list(made.people[name].joints)
        for t in range(8):
            keep = made.owners[name][t] == 0
            rows[t], made.owners[name][t] = rows[t][keep], made.owners[name][t][keep]
        made.people[name] = People(name, "COCO_17", made.people[name].frames, tuple(rows))
    found = followed(made, 1)
    owner, _ = whose(made, found)
    assert set(owner.ravel().tolist()) == {-1, 1}
    assert (owner[0] == 1).all()


def test_people_whose_rays_do_not_meet_are_refused():
    made = scene(0, CROSSING[:1], missing=0.0)
    rng = np.random.default_rng(1)
    upstairs = [one + np.array([0.0, 0.0, 1.0]) for one in walkers(CROSSING[1:])]
    other = crowd(CAMERAS, shown(CAMERAS, upstairs, rng), rng, missing=0.0)
    apart = {"front": made.people["front"], "left": other.people["left"]}
    with pytest.raises(InputError, match="front, left: expected somebody that two cameras see at once"):
        follow(apart, made.cameras, RATE_HZ)
    alone = {**made.people, "front": People("front", "COCO_17", np.array([0]), (np.empty((0, 15, 3)),))}
    with pytest.raises(InputError, match="front: no person 0: nobody is found in the frames used"):
        follow(alone, made.cameras, RATE_HZ, {"front": 0})
