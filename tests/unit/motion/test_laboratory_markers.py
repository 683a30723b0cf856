"""Tables of motion-capture programs: a known person, written in each layout, is read back in metres with z up."""

import numpy as np
import pytest

from workbench.motion.formats.markers import joint_centres, read_markers
from workbench.results.evaluate.joint_files import read_joints
from workbench.utils.errors import InputError

MARKERS = {
    "HeadL": (0.0, 0.08, 1.62), "HeadR": (0.0, -0.08, 1.62), "SpineTop": (-0.04, 0.0, 1.48),
    "LShoulderTop": (0.0, 0.2, 1.42), "LElbowOut": (-0.02, 0.26, 1.12), "LWristOut": (0.1, 0.3, 0.9),
    "LWristIn": (0.14, 0.24, 0.9), "RShoulderTop": (0.0, -0.2, 1.42), "RElbowOut": (-0.02, -0.26, 1.12),
    "RWristOut": (0.1, -0.3, 0.9), "RWristIn": (0.14, -0.24, 0.9), "WaistLFront": (0.1, 0.12, 1.0),
    "WaistRFront": (0.1, -0.12, 1.0), "WaistLBack": (-0.1, 0.06, 1.02), "WaistRBack": (-0.1, -0.06, 1.02),
    "LKneeOut": (0.02, 0.14, 0.5), "RKneeOut": (0.02, -0.14, 0.5), "LAnkleOut": (0.0, 0.12, 0.08),
    "RAnkleOut": (0.0, -0.12, 0.08),
}  # fmt: skip
"""Positions of a standing person who faces x, m, z up."""
BONES = {
    "Anna": (0.0, 0.0, 0.95), "Ab": (0.0, 0.0, 1.05), "Chest": (0.0, 0.0, 1.2), "Neck": (0.0, 0.0, 1.46),
    "Head": (0.02, 0.0, 1.56), "LShoulder": (0.0, 0.05, 1.4), "LUArm": (0.0, 0.18, 1.4), "LFArm": (0.0, 0.2, 1.1),
    "LHand": (0.1, 0.2, 0.88), "RShoulder": (0.0, -0.05, 1.4), "RUArm": (0.0, -0.18, 1.4), "RFArm": (0.0, -0.2, 1.1),
    "RHand": (0.1, -0.2, 0.88), "LThigh": (0.0, 0.09, 0.93), "LShin": (0.02, 0.1, 0.5), "LFoot": (0.0, 0.1, 0.08),
    "RThigh": (0.0, -0.09, 0.93), "RShin": (0.02, -0.1, 0.5), "RFoot": (0.0, -0.1, 0.08),
}  # fmt: skip
RATE_HZ, N_FRAMES, SPEED_M = 50.0, 8, 0.02


def motion(points):
    """Return positions (F, M, 3), m, of the person who walks along x without moving the limbs."""
    places = np.array(list(points.values()))
    return places + SPEED_M * np.arange(N_FRAMES)[:, None, None] * [1.0, 0.0, 0.0]


def y_up(places):
    """Return positions with z up in axes with y up, in which z is ahead."""
    return places[..., [1, 2, 0]]


def words(values, separator):
    return separator.join(f"{value:.3f}" for value in np.ravel(values))


def qualisys(path, titles=True, front=True):
    places, names = 1000.0 * motion(MARKERS), [f"x_{name}" for name in MARKERS]
    lines = ["NO_OF_FRAMES\t8", f"NO_OF_MARKERS\t{len(names)}", f"FREQUENCY\t{RATE_HZ:g}", "DESCRIPTION\t--"]
    lines += ["DATA_INCLUDED\t3D", "\t".join(["MARKER_NAMES", *names, ""]), "TRAJECTORY_TYPES\tMeasured"]
    lines += ["\t".join(["Frame\tTime", *(f"{name} {axis}" for name in names for axis in "XYZ"), ""])] * titles
    rows = [words(each, "\t") for each in places]
    lines += [f"{k + 1}\t{k / RATE_HZ:.5f}\t{row}" for k, row in enumerate(rows)] if front else rows
    path.write_text("\n".join(lines) + "\n")


def vicon(path):
    names = [f"Anna:{name}" for name in MARKERS]
    lines = ["Model Outputs", "100", ",,Anna:LKneeAngles", "Frame,Sub Frame,X,Y,Z", ",,deg,deg,deg", "1,0,1,2,3", ""]
    lines += ["Trajectories", f"{RATE_HZ:g}", ",," + ",,,".join([*names, "*7"]) + ",,"]
    n = len(names) + 1
    lines += ["Frame,Sub Frame," + ",".join(["X,Y,Z"] * n), ",," + ",".join(["mm"] * 3 * n)]
    places = 1000.0 * motion(MARKERS)
    lines += [f"{k + 31},0,{words(each, ',')},1,2,3" for k, each in enumerate(places) if k != 3]
    path.write_text("\n".join([*lines, ""]) + "\n")


def motive(path, bones=True):
    shown = BONES if bones else MARKERS
    columns = 7 if bones else 3
    names = [f"Anna:{name}" for name in shown for _ in range(columns)] + ["Unlabeled 7"] * 3
    types = ["Bone" if bones else "Marker"] * (len(names) - 3) + ["Marker"] * 3
    quantities = (["Rotation"] * 4 if bones else []) + ["Position"] * 3
    axes = ["X", "Y", "Z", "W", "X", "Y", "Z"] if bones else ["X", "Y", "Z"]
    lines = [
        f"Format Version,1.25,Take Name,a,Capture Frame Rate,100,Export Frame Rate,{RATE_HZ:g},Length Units,Meters"
    ]
    lines += ["", ",".join([",Type", *types]), ",".join([",Name", *names]), ",".join([",ID", *["7"] * len(names)])]
    lines += [",".join([",", *quantities * len(shown), *["Position"] * 3])]
    lines += [",".join(["Frame,Time (Seconds)", *axes * len(shown), "X", "Y", "Z"])]
    for k, each in enumerate(y_up(motion(shown))):
        cells = [("0,0,0,1," if bones else "") + words(place, ",") for place in each]
        lines.append(f"{k},{k / RATE_HZ:.6f},{','.join(cells)},,,")
    path.write_text("\n".join(lines) + "\n")


LAYOUTS = {
    "titles.tsv": lambda path: qualisys(path), "plain.tsv": lambda path: qualisys(path, titles=False),
    "bare.tsv": lambda path: qualisys(path, titles=False, front=False), "vicon.csv": vicon,
    "markers.csv": lambda path: motive(path, bones=False),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_markers_are_read_in_metres_with_z_up(tmp_path, name):
    LAYOUTS[name](tmp_path / name)
    markers = read_markers(tmp_path / name)
    assert markers.rate_hz == RATE_HZ
    assert [each.rpartition(":")[2].removeprefix("x_") for each in markers.names] == list(MARKERS)
    expected = motion(MARKERS)
    if name == "vicon.csv":
        expected[3] = np.nan
    np.testing.assert_allclose(markers.positions, expected, atol=1e-6)


def test_bones_of_motive_are_joints(tmp_path):
    motive(tmp_path / "a.csv")
    found = read_joints(tmp_path / "a.csv")
    bones = {"left_elbow": "LFArm", "right_wrist": "RHand", "left_hip": "LThigh", "right_ankle": "RFoot",
             "left_shoulder": "LUArm", "head_centre": "Head", "neck": "Neck"}  # fmt: skip
    expected = motion(BONES)
    for joint, bone in bones.items():
        places = found.positions[:, found.names.index(joint)]
        np.testing.assert_allclose(places, expected[:, list(BONES).index(bone)], atol=1e-6)
    np.testing.assert_allclose(found.times_s, np.arange(N_FRAMES) / RATE_HZ)


def test_all_markers_give_the_joints_of_the_same_person(tmp_path):
    for name, write in LAYOUTS.items():
        write(tmp_path / name)
    centres = [
        joint_centres(markers, markers.positions)[0] for markers in map(read_markers, map(tmp_path.joinpath, LAYOUTS))
    ]
    assert np.isfinite(centres[0]).all()
    for each in centres[1:]:
        np.testing.assert_allclose(each, centres[0], atol=1e-6)


@pytest.mark.parametrize(("name", "text", "message"), [
    ("a.tsv", "NO_OF_FRAMES\t2\nBODY_NAMES\ta\n1\t2\n", "line 1: expected FREQUENCY and MARKER_NAMES in Qualisys"),
    ("a.tsv", "NO_OF_FRAMES\t2\nFREQUENCY\t50\nMARKER_NAMES\ta\n", "a row for each frame"),
    ("a.tsv", "NO_OF_FRAMES\t2\nFREQUENCY\tx\nMARKER_NAMES\ta\n1\t2\t3\n", "line 2: expected numbers for the rate"),
    ("a.tsv", "NO_OF_FRAMES\t2\nFREQUENCY\t50\nMARKER_NAMES\ta\n1\t2\ta\n", "line 4: expected numbers for a frame"),
    ("a.csv", "Format Version,1.2\n\nFrame,Time\n1,2\n", "line 3: expected lines of types, names and quantities"),
    ("a.csv", "Trajectories\n100\n,,a\n", "line 1: expected Trajectories, their rate"),
])  # fmt: skip
def test_a_wrong_table_is_named_with_its_line(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_markers(tmp_path / name)
