"""Estimates are compared at common times, with intervals of paired differences."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.comparison.alignment import NONE, ROOT
from workbench.evaluation.comparison.joint_motion import JointMotion
from workbench.motion.sources import find_motion
from workbench.results.evaluate.evaluation import angle_table, compared, joint_table, score_table, trials_of
from workbench.utils.errors import InputError

MOTION = find_motion("builtin", data=None, rate_hz=100.0)
PLACES = joints(person(MOTION.shape).skeleton, MOTION.poses[:800])
TIMES_S = np.arange(800) / 100.0


def motion(every=1, noise_m=0.0, names=JOINT_NAMES, seed=0, source="file"):
    places = PLACES[::every] + noise_m * np.random.default_rng(seed).standard_normal(PLACES[::every].shape)
    rows = [JOINT_NAMES.index(name) for name in names]
    return JointMotion(
        source, tuple(names), TIMES_S[::every], places[:, rows], np.empty((0, len(places), len(rows), 3))
    )


@pytest.mark.parametrize(("own", "true", "frames"), [(1, 1, 800), (3, 1, 267), (1, 4, 200)])
def test_the_faster_motion_is_interpolated(own, true, frames):
    one = compared("a", motion(own), motion(true), NONE, 0.0)
    assert len(one.truth.times_s) == frames
    assert np.nanmax(one.scores.distances_mm) < 1e-9


def test_joints_are_matched_by_name_in_any_order():
    names = ("left_knee", "pelvis", "right_wrist")
    one = compared("a", motion(names=names), motion(), NONE, 0.0)
    assert set(one.truth.names) == set(names)
    assert np.nanmax(one.scores.distances_mm) < 1e-9
    assert "without" in one.notes[0]


def test_motions_without_common_joints_or_times_are_refused():
    with pytest.raises(InputError, match="left_knee"):
        compared("a", motion(names=("left_knee", "neck")), motion(names=("right_knee", "neck")), NONE, 0.0)
    with pytest.raises(InputError, match="no joint is known at the same time"):
        compared("a", motion(), motion(), NONE, 100.0)
    with pytest.raises(InputError, match="pelvis"):
        compared("a", motion(names=("left_knee", "neck")), motion(), ROOT, 0.0)


def test_worlds_that_differ_are_said():
    own = motion()
    own = JointMotion(own.source, own.names, own.times_s, own.positions + np.array([2.0, 0.0, 0.0]), own.samples)
    assert "2.00 m" in compared("a", own, motion(), NONE, 0.0).notes[-1]
    assert len(compared("a", motion(noise_m=0.01), motion(), NONE, 0.0).notes) == 1


def test_differences_are_paired_by_trial():
    """The trials' difficulty, 20 to 60 mm, is in both estimates; their difference is 1 mm or so in each."""
    trials = {name: [] for name in ("a", "b")}
    for k in range(12):
        for name, more in (("a", 0.0), ("b", 0.001)):
            own = motion(noise_m=0.02 + 0.003 * k + more, seed=k)
            trials[name].append(compared(f"trial {k}", own, motion(), NONE, 0.0))
    table = score_table(trials)
    rows = table[table["score"] == "mpjpe"].set_index("estimate")
    each, difference = rows.loc["a"], rows.loc["b − a"]
    assert rows["n"].eq(12).all()
    assert each["high_90"] - each["low_90"] > 10.0
    assert difference["low_90"] > 0.0
    assert difference["high_90"] - difference["low_90"] < 1.0
    assert difference["value"] == pytest.approx(rows.loc["b", "value"] - each["value"])


def test_an_only_trial_has_intervals_over_its_seconds():
    table = score_table({"a": [compared("t", motion(noise_m=0.02), motion(), NONE, 0.0)]})
    row = table[table["score"] == "mpjpe"].iloc[0]
    assert row["n"] == 8
    assert row["low_90"] < row["value"] < row["high_90"]


@pytest.mark.parametrize(("n", "known"), [(4, False), (5, True)])
def test_few_trials_have_no_interval(n, known):
    trials = [compared(f"{k}", motion(noise_m=0.02, seed=k), motion(), NONE, 0.0) for k in range(n)]
    table = score_table({"a": trials})
    assert table[table["score"] == "mpjpe"]["low_90"].notna().all() == known


def test_tables_of_joints_and_angles():
    own = motion()
    own.positions[:, JOINT_NAMES.index("left_wrist")] += [0.0, 0.03, 0.0]
    one = compared("t", own, motion(), NONE, 0.0)
    errors = joint_table({"a": [one]}).set_index("joint")["a"]
    assert errors["left_wrist"] == pytest.approx(30.0)
    assert errors["right_wrist"] == pytest.approx(0.0, abs=1e-9)
    angles = angle_table({"a": [one]}).set_index("angle")
    row = angles.loc["left_elbow"]
    assert row["rmse_deg"] > abs(row["bias_deg"])
    assert row["loa_high_deg"] - row["loa_low_deg"] == pytest.approx(
        2 * 1.96 * np.sqrt(row["rmse_deg"] ** 2 - row["bias_deg"] ** 2)
    )
    assert angles.loc["left_knee", "rmse_deg"] == pytest.approx(0.0, abs=1e-6)


def test_trials_are_paired_by_name(tmp_path):
    for folder, files in (("truth", ["one.trc", "two.trc"]), ("own", ["two.csv", "one.bvh", "note.txt"])):
        (tmp_path / folder).mkdir()
        for name in files:
            (tmp_path / folder / name).touch()
    (tmp_path / "own/three").mkdir()
    (tmp_path / "own/three/run.rrd").touch()
    found = trials_of(tmp_path / "own", tmp_path / "truth")
    assert [(name, own.name, true.name) for name, own, true in found] == [
        ("one", "one.bvh", "one.trc"), ("two", "two.csv", "two.trc"),
    ]  # fmt: skip
    (tmp_path / "truth/three.trc").touch()
    assert trials_of(tmp_path / "own", tmp_path / "truth")[1][1].name == "three"
    (tmp_path / "truth/four.trc").touch()
    with pytest.raises(InputError, match="four"):
        trials_of(tmp_path / "own", tmp_path / "truth")
    with pytest.raises(InputError, match="folder"):
        trials_of(tmp_path / "own/one.bvh", tmp_path / "truth")
    with pytest.raises(InputError, match="file"):
        trials_of(tmp_path / "own", tmp_path / "truth/one.trc")
