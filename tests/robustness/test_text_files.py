"""Damaged text files of every format are refused with file and line, soon and within the memory limit."""

import json
import os

import pytest
from damage import refusal, withstands
from openpose_scenes import people_in
from valid_files import (
    AMC,
    ANNOTATIONS,
    ASF,
    BVH,
    HUMANEVA,
    LENS,
    MC_CALIB,
    MULTICAL,
    QUALISYS,
    STEREO,
    TOML,
    TRC,
    VICON,
    written,
)

from workbench.cameras.camera_file import load_cameras, load_lenses
from workbench.detections.joint_annotations import read_annotations
from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.formats.markers import read_markers
from workbench.utils import input_limits
from workbench.utils.input_limits import MAX_JOINTS, MAX_NUMBERS

KEYPOINTS = json.dumps({"people": [{"pose_keypoints_2d": [float(k % 7) for k in range(75)]}]})


def read_detections(path):
    return people_in(path.parent)


def read_skeleton(path):
    return read_amc(path.with_name("5_01.amc"), path)


FORMATS = {
    "a.csv": (read_annotations, ANNOTATIONS),
    "a.trc": (read_markers, TRC),
    "a_1.json": (read_detections, KEYPOINTS),
    "a.toml": (load_cameras, TOML),
    "a.yml": (load_cameras, STEREO),
    "a.xml": (load_lenses, LENS),
    "a.qca.txt": (load_cameras, QUALISYS),
    "a.xcp": (load_cameras, VICON),
    "a.cal": (load_cameras, HUMANEVA),
    "multical.json": (load_cameras, MULTICAL),
    "mccalib.yml": (load_cameras, MC_CALIB),
    "a.bvh": (read_bvh, BVH),
    "5.asf": (read_skeleton, ASF),
    "5_01.amc": (read_amc, AMC),
}
DEFECTS = [  # file, old, new, line, part of the message
    ("a.bvh", BVH, "", 1, "expected HIERARCHY"),
    ("a.bvh", BVH[BVH.index("MOTION") :], "", 15, "expected MOTION, found the end of the file"),
    ("a.bvh", "  }\n}\nMOTION", "}\nMOTION", 15, "closing brace"),
    ("a.bvh", "JOINT arm", "JOINT", 6, "a joint's name, found ''"),
    ("a.bvh", "    OFFSET 0 100 0\n", "", 13, "OFFSET of arm"),
    ("a.bvh", "OFFSET 0 100 0", "OFFSET 0 up 0", 8, "found '0 up 0'"),
    ("a.bvh", "CHANNELS 3", "CHANNELS 4", 9, "the number of rotations and positions of arm"),
    ("a.bvh", "Frames: 2", "Frames: 0", 17, "a whole number of frames"),
    ("a.bvh", "Time: 0.0333333", "Time: 3600", 18, "between 0.00001 and 10 s"),
    ("a.bvh", "1 2 3 4 5 6 7 8 9\n1 2 3 4 5 6 7 8 9\n", "", 18, "expected lines of frames after the header"),
    ("a.bvh", "7 8 9\n1 2 3 4 5 6 7 8 9", "7 8 9\n1 2 3 4 5", 20, "9 values for frame 2, found 5"),
    ("a.bvh", "7 8 9\n1", "7 inf 9\n1", 19, "expected numbers for frame 1"),
    ("a.bvh", "7 8 9\n1", "7 1_0 9\n1", 19, "expected numbers for frame 1"),
    ("a.trc", "PathFileType", "Path", 1, "expected a TRC file"),
    ("a.trc", "neck\t\t\tleft_ankle", "", 4, "expected the names of markers, found none"),
    ("a.trc", "\t1.5\t0\t0\t0.1", "\t1.5.0\t0\t0\t0.1", 6, "expected numbers for coordinates"),
    ("5.asf", ASF, "", 1, ":bonedata and :hierarchy"),
    ("5.asf", "length 0.45", "length long", 2, "numbers for the unit of length"),
    ("5.asf", "angle deg", "angle grad", 3, "deg or rad, found 'grad'"),
    ("5.asf", "TX TY TZ RX RY RZ", "TX TY TZ", 5, "TX TY TZ RX RY RZ in any order"),
    ("5.asf", "position 0 0 0", "position 0 1", 7, "the root's position"),
    ("5.asf", "name shin", "name thigh", 22, "a unique name, found 'thigh'"),
    ("5.asf", "length 7", "length -7", 16, "not negative"),
    ("5.asf", "dof rx ry", "dof rx tx", 15, "some of rx ry rz"),
    ("5.asf", "root thigh", "root hip", 25, "expected bones of :bonedata, found 'hip'"),
    ("5.asf", "root thigh\n    thigh shin", "thigh shin\n    shin thigh", 27, "to descend from the root"),
    ("5_01.amc", AMC, "", 1, "expected frames, found none"),
    ("5_01.amc", "5\nroot", "root", 4, "the number of a frame, found 'root"),
    ("5_01.amc", "0\nthigh 1 2\n6", "0\nthigh 1\n6", 6, "2 values for thigh in frame 5, found 1"),
    ("5_01.amc", "thigh 1 2\n6", "hip 1 2\n6", 6, "in the skeleton, found 'hip' in frame 5"),
    ("5_01.amc", "thigh 1 2\n6", "thigh 1 -1.#INF\n6", 6, "expected numbers for thigh"),
    ("5_01.amc", "\n6\n", "\n5\n", 7, "a number above 5 of a frame, found '5'"),
]
BOMBS = [
    *[("a.toml", text) for text in (
        ".".join("a" * 200_000) + " = 1", "[" + ".".join("a" * 200_000) + "]", 'a."b".' * 100 + "c = 1",
        "a = " + "[" * 5000, "a = " + "{b = " * 3000 + "}" * 3000, "a = 1" + "0" * 5000,
        "\n".join(f"a{k}.b = 1" for k in range(80_000)), "x" * 900_000, "#" * 1_000_001,
    )],
    *[("a.yml", text) for text in (
        "M1: " + "[" * 5000, "M1: " + "1:" * 100_000 + "1", "a: &a [1]\nM1: *a", "{M1: " * 3000, "x" * 1_000_001,
        STEREO.replace("500.", "1e400"), STEREO.replace("640", "1e9"), STEREO.replace("-0.5", "1e9"),
    )],
    *[("a.xml", text) for text in ("<a>" * 200_000, "<a>" + "<b/>" * 200_000, LENS.replace("640", "6" * 5000))],
    *[("a.xcp", text) for text in (
        "<a>" * 60_000 + "</a>" * 60_000, VICON.replace("1e-7", "1e300"), VICON.replace("0.5 0.5 -0.5", "1e200 0 0"),
    )],
    *[("a_1.json", text) for text in (
        "[" * 100_000, '{"a":' * 100_000, "1" * 5000, '{"people": 3}', '{"people": [{}]}',
        KEYPOINTS.replace("0.0, ", "", 1), *[KEYPOINTS.replace("1.0", new) for new in ('"a"', "1e400", "1e8")],
        b"\xff\xfe\x00",
    )],
    *[("a.trc", TRC.replace("60\t60", f"{rate}\t60")) for rate in ("0", "-30", "nan", "inf", "1e300", "0.01")],
    *[("a.csv", ANNOTATIONS.replace("31,23", f"{value},23")) for value in ("1e8", "nan", "-inf", "x", "9" * 400, "")],
]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """Return a folder with sound ASF and AMC files, which are read together."""
    for name in ("5.asf", "5_01.amc"):
        written(tmp_path / name, FORMATS[name][1])
    return tmp_path


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.slow
def test_random_damage_is_refused_or_read(folder, name):
    read, sound = FORMATS[name]
    withstands(read, written(folder / name, sound), 200)


@pytest.mark.parametrize(("name", "old", "new", "line", "message"), DEFECTS)
def test_a_defect_is_refused_with_its_line(folder, name, old, new, line, message):
    read, sound = FORMATS[name]
    assert old in sound
    refused = refusal(read, written(folder / name, sound.replace(old, new, 1)))
    assert refused.startswith(f"{folder / name}, line {line}: ")
    assert message in refused


@pytest.mark.parametrize(("name", "content"), BOMBS, ids=range(len(BOMBS)))
def test_a_bomb_is_refused_with_its_file(tmp_path, name, content):
    assert f"{tmp_path / name}" in refusal(FORMATS[name][0], written(tmp_path / name, content))


@pytest.mark.parametrize("name", ["a.csv", "a.toml"])
def test_a_pipe_and_a_folder_are_refused(tmp_path, name):
    os.mkfifo(tmp_path / name)
    assert refusal(FORMATS[name][0], tmp_path / name).endswith("expected a file, found none")
    (tmp_path / "folder").mkdir()
    assert refusal(load_cameras, tmp_path / "folder").endswith("expected a file, found a folder")


def test_an_amc_file_without_its_skeleton_is_refused(tmp_path):
    assert refusal(read_amc, written(tmp_path / "5_01.amc", AMC)).endswith("5.asf: no such file")


def test_more_joints_markers_and_coordinates_than_the_limits_are_refused(tmp_path):
    joints = "".join(f"JOINT j{k}\n{{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Zrotation Yrotation\n" for k in range(20_000))
    path = written(tmp_path / "a.bvh", BVH.replace("  JOINT arm", f"{joints}  JOINT arm"))
    assert f"at most {MAX_JOINTS} joints" in refusal(read_bvh, path)
    lines = TRC.split("\n")
    lines[3] = "Frame#\tTime\t" + "\t".join(f"m{k}\t\t" for k in range(MAX_JOINTS + 1))
    assert "markers" in refusal(read_markers, written(tmp_path / "a.trc", "\n".join(lines)))
    lines[3] = "Frame#\tTime\t" + "\t".join(f"m{k}\t\t" for k in range(MAX_JOINTS))
    rows = ["1\t0"] * (MAX_NUMBERS // 3 // MAX_JOINTS + 1)  # empty cells at the end of the line
    assert "coordinates" in refusal(read_markers, written(tmp_path / "b.trc", "\n".join([*lines, *rows])))


def test_keywords_of_bones_may_be_in_upper_case(folder):
    upper = "\n".join(line.replace("dof", "DOF").replace("axis", "Axis") for line in ASF.split("\n"))
    assert upper != ASF
    written(folder / "5.asf", upper)
    assert not refusal(read_amc, folder / "5_01.amc")


@pytest.mark.parametrize(("name", "n_values"), [("a.bvh", 2 * 9), ("5_01.amc", 2 * 8)])
def test_the_values_of_a_skeletons_channels_are_bounded(folder, monkeypatch, name, n_values):
    read, sound = FORMATS[name]
    path = written(folder / name, sound)
    monkeypatch.setattr(input_limits, "MAX_VALUES", n_values)
    assert not refusal(read, path)
    monkeypatch.setattr(input_limits, "MAX_VALUES", n_values - 1)
    assert refusal(read, path)


TABLES = ("a.csv", "a.trc", "a.toml", "a.bvh", "5_01.amc")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
@pytest.mark.parametrize("name", TABLES)
def test_text_in_the_encodings_of_windows_is_read(folder, name, encoding):
    read, sound = FORMATS[name]
    assert not refusal(read, written(folder / name, sound.replace("\n", "\r\n").encode(encoding)))


@pytest.mark.parametrize(("focal", "is_refused"), [("-80.0", True), ("0.0", True), ("0.99", True), ("1.0", False)])
def test_a_focal_length_is_a_pixel_or_more(tmp_path, focal, is_refused):
    path = written(tmp_path / "a.toml", TOML.replace("80.0", focal, 1))
    assert ("focal lengths of 1 px" in refusal(load_cameras, path)) == is_refused
