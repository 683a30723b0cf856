"""Performers in the names of clips, and the subjects that are excluded from training."""

import pytest

from workbench.motion.formats.names import excluded_subjects, performer
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.gait import builtin_motions
from workbench.motion.synthetic.run_gait import builtin_runs


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("35_02", "35"), ("3502", "35"), ("clips/35_02.amc", "35"), ("walks.h5:35_02", "35"),
        ("dataset-1_byebye_giant_001", "bandai-1"), ("a/dataset-2_walk_normal_001.bvh", "bandai-2"),
        ("my_walk.bvh", None), ("walks.h5:monday", None), ("builtin", None),
    ],
)  # fmt: skip
def test_the_performer_is_read_from_a_clips_name(name, expected):
    assert performer(name) == expected


def test_tracked_clips_exclude_their_performer_or_else_themselves():
    assert excluded_subjects(["35_02", "32_02", "35_15", "builtin", "my_walk.bvh", "joints.trc"]) == [
        "35",
        "32",
        "my_walk",
    ]
    assert excluded_subjects(["dataset-1_run_active_001", "dataset-1_walk_active_001"]) == ["bandai-1"]


def test_generated_people_to_track_are_not_in_the_training_motions():
    trained = {motion.subject: motion.shape for motion in (*builtin_motions(), *builtin_runs())}
    for seed in range(8):
        for name in ("builtin", "builtin_run"):
            tracked = find_motion(name, data=None, rate_hz=2.0, seed=seed)
            assert tracked.subject not in trained
            assert tracked.shape not in trained.values()
