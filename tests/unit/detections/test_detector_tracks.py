"""People whom the detector follows keep its tracks, and fragments of one person are joined."""

import json

import numpy as np
import pytest
from openpose_scenes import people_in, points, standing, write

from workbench.detections.association.detector_tracks import people_followed
from workbench.detections.association.target_selection import select_target
from workbench.detections.readers.keypoint_files import read_points
from workbench.utils.errors import InputError

RATE_HZ = 30.0
WORLD = np.random.default_rng(0).normal(0.0, 0.4, (33, 3)).ravel().tolist()


def detections(folder, *tracks):
    """Write the workbench's own detections of (number, first frame, positions (F, 2) of the head, size), px."""
    frames = dict[int, list]()
    for number, first, places, size in tracks:
        for t, (u, v) in enumerate(places, first):
            person = {"pose_keypoints_2d": points("BLAZEPOSE_33", standing(u, v, size)).ravel().tolist()}
            frames.setdefault(t, []).append(
                person | {"person_id": [number], "world_landmarks": WORLD, "region": [0.0] * 4}
            )
    folder.mkdir()
    for t in range(max(frames) + 1):
        (folder / f"walk_{t:012d}_keypoints.json").write_text(json.dumps({"people": frames.get(t, [])}))
    return people_in(folder)


def people(found):
    """Return the people in every frame."""
    assigned = people_followed(found.joints, found.identities, np.arange(len(found.frames)) / RATE_HZ)
    return [set(frame.values()) for frame in assigned]


def line(first, last, n):
    return np.linspace(first, last, n)


def test_a_person_whom_the_detector_follows_is_one_person_however_fast(tmp_path):
    jumping = np.array([[100.0 + 250.0 * (t % 3), 100.0 + 150.0 * (t % 2)] for t in range(40)])  # more than a height
    followed = detections(tmp_path / "own", (0, 0, jumping, 200.0))
    target = select_target({"": followed}, None, RATE_HZ)
    assert target.counts["people"] == 1
    assert target.counts["frames_unseen"] == 0


@pytest.mark.parametrize(
    ("place", "size", "n_people"),
    [((270.0, 100.0), 200.0, 1), ((270.0, 100.0), 60.0, 2), ((900.0, 100.0), 200.0, 2)],
    ids=["where the walk leads", "another size", "elsewhere"],
)
def test_fragments_of_one_person_are_joined(tmp_path, place, size, n_people):
    first = line((100.0, 100.0), (190.0, 100.0), 30)  # 3 px a frame, and unseen for 26 frames
    second = place + line((0.0, 0.0), (90.0, 0.0), 30)
    found = detections(tmp_path / "own", (0, 0, first, 200.0), (3, 56, second, size))
    assert set().union(*people(found)) == set(range(n_people))


def test_a_number_that_moves_to_a_person_whose_number_ends_continues_that_person(tmp_path):
    covered, near = line((400.0, 100.0), (100.0, 100.0), 30), line((100.0, 100.0), (160.0, 100.0), 60)
    found = detections(
        tmp_path / "own",
        (0, 0, np.concatenate([covered[:20], near[20:]]), 200.0),  # at frame 20 its region moves to the other person
        (1, 0, near[:20], 200.0),
    )  # fmt: skip
    followed = people(found)
    assert followed[:20] == [{0, 1}] * 20
    assert followed[20:] == [{1}] * 40


def test_short_tracks_are_false_detections_unless_all_are(tmp_path):
    long, short = line((100.0, 100.0), (160.0, 100.0), 60), np.full((14, 2), 500.0)
    assert set().union(*people(detections(tmp_path / "a", (0, 0, long, 200.0), (1, 9, short, 50.0)))) == {0}
    enough = (1, 9, long[:15] + 300.0, 50.0)
    assert set().union(*people(detections(tmp_path / "b", (0, 0, long, 200.0), enough))) == {0, 1}
    assert set().union(*people(detections(tmp_path / "c", (1, 9, short, 50.0)))) == {0}


def test_the_largest_person_is_the_target_when_the_camera_moves_all(tmp_path):
    tall = line((100.0, 100.0), (400.0, 100.0), 40)
    small = line((0.0, 100.0), (900.0, 100.0), 40)
    found = {"": detections(tmp_path / "own", (0, 0, small, 60.0), (1, 0, tall, 200.0))}
    assert np.nanmax(select_target(found, None, RATE_HZ, "moving").joints[0, 0, :, 1]) > 250.0


def test_numbers_are_those_of_order_of_appearance_and_others_are_rejected(tmp_path):
    a, b = line((100.0, 100.0), (160.0, 100.0), 30), line((600.0, 100.0), (660.0, 100.0), 20)
    found = {"walk": detections(tmp_path / "own", (7, 0, a, 200.0), (2, 25, b, 200.0))}
    assert select_target(found, None, RATE_HZ, 1).counts["frames_unseen"] == 25
    with pytest.raises(InputError, match=r"walk: no person 2, expected 0 to 1: .*people\.png"):
        select_target(found, None, RATE_HZ, 2)


def test_frames_that_may_show_the_target_are_lost(tmp_path):
    shown, gap = line((100.0, 100.0), (190.0, 100.0), 30), line((190.0, 100.0), (280.0, 100.0), 30)
    bystander, other = np.full((90, 2), 600.0), np.full((20, 2), (1500.0, 100.0))
    tracks = [(0, 10, shown, 200.0), (1, 0, bystander, 150.0), (2, 50, gap, 200.0)]
    counts = select_target({"": detections(tmp_path / "a", *tracks)}, None, RATE_HZ, 1).counts
    assert (counts["frames_unseen"], counts["frames_lost"]) == (30, 10)  # between frames 40 and 50
    tracks = [(0, 0, shown, 200.0), (2, 40, other, 200.0)]  # another place, but perhaps the same person
    counts = select_target({"": detections(tmp_path / "b", *tracks)}, None, RATE_HZ, 0).counts
    assert (counts["frames_unseen"], counts["frames_lost"]) == (30, 20)


def test_frames_without_a_file_of_detections_count(tmp_path):
    def counts(frames, within):
        found = {k: [points("COCO_17", standing(100.0 + k, 40.0))] for k in frames}
        people = people_in(write(tmp_path / f"{min(frames)} {len(frames)}", found))
        counts = select_target({"": people}, None, RATE_HZ, within=within).counts
        return tuple(counts[f"frames{name}"] for name in ("", "_empty", "_unseen", "_lost", "_before", "_after"))

    assert counts([*range(10, 30), *range(60, 80)], (0, 99)) == (100, 60, 60, 30, 10, 20)
    assert counts([*range(10, 30), *range(60, 80)], (0, None)) == (80, 40, 40, 30, 10, 0)
    assert counts(range(4, 94, 3), (0, 99)) == (33, 3, 3, 0, 1, 2)  # every third frame: 1, 4, …, 97


def test_only_the_workbenchs_own_numbers_identify_people(tmp_path):
    assert read_points(write(tmp_path / "openpose", {0: [points("COCO_17", standing(9.0, 9.0))]})).identities is None
    own = detections(tmp_path / "own", (4, 0, np.zeros((2, 2)) + 9.0, 100.0))
    assert [each.tolist() for each in own.identities] == [[4], [4]]
    (tmp_path / "own" / "walk_000000000000_keypoints.json").write_text(
        json.dumps({"people": [{"person_id": ["x"], "region": [], "pose_keypoints_2d": []}]})
    )
    with pytest.raises(InputError, match="expected people"):
        read_points(tmp_path / "own")


def test_nobody_is_followed_across_a_cut_and_the_target_is_the_most_prominent_of_all_parts(tmp_path):
    walk = line((100.0, 100.0), (280.0, 100.0), 90)
    found = {"film": detections(tmp_path / "own", (0, 0, walk[:60], 200.0), (0, 60, walk[60:], 400.0))}
    whole = select_target(found, None, RATE_HZ)
    assert (whole.counts["people"], whole.counts["frames_unseen"]) == (1, 0)
    assert "cuts" not in whole.counts
    for cuts in ((40,), (40, 95), (0, 40)):  # 0 and 95 are no cuts of these frames
        counts = select_target(found, None, RATE_HZ, cuts=cuts).counts
        assert (counts["people"], counts["frames_unseen"], counts["frames_lost"]) == (2, 40, 40)
        assert [counts[name] for name in ("cuts", "first_cut", "part_first", "part_last")] == [1, 40, 40, 89]
    first = select_target(found, None, RATE_HZ, 0, cuts=(40,))
    assert np.isfinite(first.joints[0, :, :, 0]).any(axis=1).tolist() == [True] * 40 + [False] * 50
    counts = select_target(found, None, RATE_HZ, 1, (10, 80), cuts=(40, 70)).counts
    assert [counts[name] for name in ("cuts", "first_cut", "part_first", "part_last")] == [2, 40, 40, 69]
