"""Motions of named joints are read from the files of other programs, and other files are refused in one sentence."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.readers.formats import LAYOUTS
from workbench.motion.sources import Reading, find_motion
from workbench.results.evaluate.joint_files import SEVENTEEN, read_joints
from workbench.utils.errors import InputError

RATE_HZ = 25.0
N_FRAMES = 40
MOTION = find_motion("builtin", data=None, rate_hz=RATE_HZ)
PLACES = joints(person(MOTION.shape).skeleton, MOTION.poses[:N_FRAMES])
TIMES_S = np.arange(N_FRAMES) / RATE_HZ
LIMBS = [name for name in JOINT_NAMES if name.split("_")[0] in ("left", "right")]


def of(names):
    return PLACES[:, [JOINT_NAMES.index(name) for name in names]]


def array_of(points):
    """Return an array of points by name, of which those that are no joints are somewhere near the head."""
    places = np.tile(of(["neck"]), (1, len(points), 1)) + 0.1
    for k, point in enumerate(points):
        if point in JOINT_NAMES:
            places[:, k] = of([point])[:, 0]
    return places


def check(motion, names=tuple(LIMBS), times_s=TIMES_S):
    assert set(names) <= set(motion.names)
    rows = [motion.names.index(name) for name in names]
    np.testing.assert_allclose(motion.positions[:, rows], of(names), atol=1e-6)
    np.testing.assert_allclose(motion.times_s, times_s)


def test_an_array_with_names_and_times(tmp_path):
    np.savez(tmp_path / "a.npz", joints=PLACES, names=np.array(JOINT_NAMES), time_s=TIMES_S)
    check(read_joints(tmp_path / "a.npz"), JOINT_NAMES)


@pytest.mark.parametrize("layout", ["BLAZEPOSE_33", "COCO_133"])
def test_an_array_without_names_has_a_known_number_of_joints(tmp_path, layout):
    np.savez(tmp_path / "a.npz", array_of(LAYOUTS[layout]), fps=RATE_HZ)
    motion = read_joints(tmp_path / "a.npz")
    check(motion)
    middle = 0.5 * (of(["left_hip"]) + of(["right_hip"]))
    np.testing.assert_allclose(motion.positions[:, [motion.names.index("pelvis")]], middle, atol=1e-6)


@pytest.mark.parametrize("layout", ["Human3.6M", "COCO"])
def test_the_lengths_of_the_limbs_show_which_17_joints_an_array_has(tmp_path, layout):
    np.save(tmp_path / "a.npy", array_of(SEVENTEEN[layout]))
    check(read_joints(tmp_path / "a.npy", Reading(rate_hz=RATE_HZ)))


def test_joints_of_smpl_y_down_in_centimetres(tmp_path):
    """As cameras have y down, and z ahead."""
    points = (
        "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
        "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
        "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    )  # fmt: skip
    world = array_of(points)
    np.savez(tmp_path / "a.npz", 100.0 * np.stack([world[..., 1], -world[..., 2], world[..., 0]], axis=-1) + 1.0)
    motion = read_joints(tmp_path / "a.npz", Reading(rate_hz=RATE_HZ))
    heights = motion.positions[:, motion.names.index("left_ankle"), 2] - motion.positions[:, 0, 2]
    np.testing.assert_allclose(heights, (of(["left_ankle"]) - of(["pelvis"]))[:, 0, 2], atol=1e-6)


@pytest.mark.parametrize(
    "style", ["{name}_{axis}", "{name}.{axis}", "{name} {axis}", "{name}_{axis}_m", "{name}{axis}"]
)
@pytest.mark.parametrize("delimiter", [",", ";"])
def test_a_table_with_three_columns_for_each_joint(tmp_path, style, delimiter):
    header = ["time", *[style.format(name=name, axis=axis) for name in LIMBS for axis in "xyz"], "confidence"]
    rows = [
        [f"{value:.7f}" for value in (time_s, *frame.ravel(), 1.0)]
        for time_s, frame in zip(TIMES_S, of(LIMBS), strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join(delimiter.join(row) for row in [header, *rows]))
    check(read_joints(tmp_path / "a.csv"))


@pytest.mark.parametrize(("interval", "expected_s"), [
    (1.0, 1.0), (1.001, 1.001e-3), (40.0, 0.04), (1000.0, 1.0), (40_000.0, 0.04), (40_000_000, 0.04)
])  # fmt: skip
def test_times_more_than_a_second_apart_are_in_smaller_units(tmp_path, interval, expected_s):
    """As sensors and cameras write them, s to ns, also since 1970."""
    header = ["timestamp", *[f"JOINT_{name.upper()}.{axis}" for name in LIMBS for axis in "xyz"]]
    first = 1_700_000_000_000_000_000 if interval == 40_000_000 else 0
    rows = [[str(first + k * interval), *map(str, frame.ravel())] for k, frame in enumerate(of(LIMBS))]
    (tmp_path / "a.csv").write_text("\n".join(",".join(row) for row in [header, *rows]))
    motion = read_joints(tmp_path / "a.csv")
    np.testing.assert_allclose(np.diff(motion.times_s), expected_s, atol=1e-6)


def test_empty_cells_of_a_table_are_missing(tmp_path):
    header = ["t", *[f"{name}_{axis}" for name in LIMBS for axis in "xyz"]]
    rows = [[str(time_s), *map(str, frame.ravel())] for time_s, frame in zip(TIMES_S, of(LIMBS), strict=True)]
    rows[3][1:4] = ["", "nan", ""]
    (tmp_path / "a.csv").write_text("\n".join(",".join(row) for row in [header, *rows]))
    motion = read_joints(tmp_path / "a.csv")
    missing = np.isnan(motion.positions).any(axis=2)
    assert missing.sum() == 1
    assert missing[3, motion.names.index(LIMBS[0])]


@pytest.mark.parametrize("mirrored", [False, True])
def test_knees_that_bend_backwards_are_reported(tmp_path, caplog, mirrored):
    """As in files with left-handed axes."""
    np.savez(tmp_path / "a.npz", joints=PLACES * [1.0, -1.0 if mirrored else 1.0, 1.0], names=np.array(JOINT_NAMES),
             time_s=TIMES_S)  # fmt: skip
    read_joints(tmp_path / "a.npz")
    assert ("bend backwards" in caplog.text) == mirrored


@pytest.mark.parametrize(("angle_deg", "reported"), [(19.0, False), (21.0, True)])
def test_slightly_overextended_knees_are_not_reported(tmp_path, caplog, angle_deg, reported):
    angle = np.radians(angle_deg)
    leg = {side: np.array([[0.0, y, 0.9], [0.0, y, 0.5], [0.4 * np.sin(angle), y, 0.5 - 0.4 * np.cos(angle)]])
           for side, y in (("left", 0.1), ("right", -0.1))}  # fmt: skip
    names = [f"{side}_{joint}" for side in leg for joint in ("hip", "knee", "ankle")] + ["neck"]
    places = np.concatenate([*leg.values(), [[0.0, 0.0, 1.4]]])
    np.savez(tmp_path / "a.npz", joints=np.tile(places, (3, 1, 1)), names=np.array(names), fps=RATE_HZ)
    read_joints(tmp_path / "a.npz", Reading(unit="m", up="z"))
    assert ("bend backwards" in caplog.text) == reported


def test_joint_centres_that_are_only_announced_do_not_hide_measured_markers(tmp_path):
    """As Cortex writes virtual markers: the header has them, the frames end before them."""
    names = [*LIMBS, "V_left_Knee_JC", "V_R.Knee_JC"]
    header = ["t", *[f"{name}_{axis}" for name in names for axis in "xyz"]]
    rows = [[str(time_s), *map(str, frame.ravel())] for time_s, frame in zip(TIMES_S, of(LIMBS), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(",".join(row) for row in [header, *rows]))
    check(read_joints(tmp_path / "a.csv"))


def test_markers_of_a_joint_that_are_never_measured_together_are_refused(tmp_path):
    columns = [f"{name}_{axis}" for name in ("R.Knee", "R.Knee.Medial") for axis in "xyz"]
    (tmp_path / "a.csv").write_text(",".join(["t", *columns]) + "\n0,1,1,1,,,\n1,,,,1,1,1\n")
    with pytest.raises(InputError, match="no frame has all markers of a joint"):
        read_joints(tmp_path / "a.csv", Reading(unit="m", up="z"))


def write_npz(path, **arrays):
    np.savez(path, **arrays)


@pytest.mark.parametrize(("arrays", "wrong"), [
    ({"joints": PLACES, "names": np.array(JOINT_NAMES)}, "times"),
    ({"joints": PLACES, "names": np.array(JOINT_NAMES), "time_s": TIMES_S[::-1]}, "increase"),
    ({"joints": PLACES, "fps": 30.0}, "names"),
    ({"joints": PLACES[..., :2], "fps": 30.0}, "one array of joints"),
    ({"a": PLACES, "b": PLACES, "fps": 30.0}, "one array of joints"),
    ({"joints": PLACES, "names": np.array([f"p{k}" for k in range(15)]), "fps": 30.0}, "joint"),
    ({"joints": PLACES, "names": np.array(JOINT_NAMES, dtype=object), "fps": 30.0}, "NPZ"),
])  # fmt: skip
def test_other_arrays_are_refused(tmp_path, arrays, wrong):
    write_npz(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=wrong) as error:
        read_joints(tmp_path / "a.npz")
    assert "a.npz" in str(error.value)


@pytest.mark.parametrize(("name", "content"), [
    ("a.npz", b"PK\x03\x04 no archive"), ("a.csv", b"time,speed\n0,1\n"), ("a.csv", b"\n"), ("a.csv", b""),
    ("a.csv", b"left_knee_x,left_knee_y,left_knee_z\n1,2,three\n"),
    ("a.csv", b"time,left_knee_x_m,left_knee_y_m,left_knee_z_mm\n0,1,2,3\n"),
    ("a.mot", b"time knee_angle_r\n"), ("a.txt", b"1 2 3"),
])  # fmt: skip
def test_other_files_are_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_joints(tmp_path / name)
