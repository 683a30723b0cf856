import pytest

from workbench.motion.formats.names import excluded_subjects, performer
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.gait import builtin_motions
from workbench.motion.synthetic.run_gait import builtin_runs


@pytest.mark.parametrize(
    ("name", "who"),
    [
        ("35_02", "35"), ("3502", "35"), ("clips/35_02.amc", "35"), ("walks.h5:35_02", "35"),
        ("dataset-1_byebye_giant_001", "bandai-1"), ("a/dataset-2_walk_normal_001.bvh", "bandai-2"),
        ("my_walk.bvh", None), ("walks.h5:monday", None), ("builtin", None),
    ],
)  # fmt: skip
def test_a_name_tells_its_performer_where_it_can(name, who):
    assert performer(name) == who


def test_who_is_tracked_is_left_out_by_performer_or_else_by_clip():
    assert excluded_subjects(["35_02", "32_02", "35_15", "builtin", "my_walk.bvh", "joints.trc"]) == [
        "35",
        "32",
        "my_walk",
    ]
    assert excluded_subjects(["dataset-1_run_active_001", "dataset-1_walk_active_001"]) == ["bandai-1"]


def test_nobody_who_is_generated_to_be_tracked_is_among_those_to_learn_from():
    trained = {motion.subject: motion.shape for motion in (*builtin_motions(), *builtin_runs())}
    for seed in range(20):
        for name in ("builtin", "builtin_run"):
            tracked = find_motion(name, data=None, rate_hz=2.0, seed=seed)
            assert tracked.subject not in trained
            assert tracked.shape not in trained.values()
