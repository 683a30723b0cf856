"""What motion files may not be: every refusal names the file, and the line where there is one."""

import pytest
from hostile import BVH

from workbench.errors import InputError
from workbench.mocap.asf_amc import read_amc, read_asf
from workbench.mocap.bvh import read_bvh

BAD_BVH = {  # what: (old, new, line, what the sentence says)
    "empty": (BVH, "", 1, "expected HIERARCHY"),
    "not a BVH file": ("HIERARCHY", "# AST/ASF file", 1, "expected HIERARCHY"),
    "only the hierarchy": (BVH[BVH.index("MOTION") :], "", 15, "expected MOTION, found the end of the file"),
    "cut in the hierarchy": (BVH[BVH.index("  JOINT") :], "MOTION\n", 6, "closing brace of hips"),
    "a brace too few": ("  }\n}\nMOTION", "}\nMOTION", 15, "closing brace"),
    "a brace too many": ("}\nMOTION", "}\n}\nMOTION", 16, "found '}'"),
    "no brace after a joint": ("JOINT arm\n  {", "JOINT arm", 7, "expected {, found 'OFFSET"),
    "two roots": ("MOTION\n", "ROOT other\n{\n}\nMOTION\n", 16, "found 'ROOT other'"),
    "a joint without name": ("JOINT arm", "JOINT", 6, "a new joint's name"),
    "a name twice": ("JOINT arm", "JOINT hips", 6, "a new joint's name, found 'hips'"),
    "no offset": ("    OFFSET 0 100 0\n", "", 13, "OFFSET and CHANNELS of arm"),
    "no channels": ("    CHANNELS 3 Xrotation Zrotation Yrotation\n", "", 13, "OFFSET and CHANNELS of arm"),
    "two numbers of an offset": ("OFFSET 0 100 0", "OFFSET 0 100", 8, "3 values for the offset of arm, found 2"),
    "a word in an offset": ("OFFSET 0 100 0", "OFFSET 0 up 0", 8, "found '0 up 0'"),
    "a wrong count of channels": ("CHANNELS 3", "CHANNELS 4", 9, "3 rotations"),
    "a rotation twice": ("3 Xrotation Zrotation", "3 Zrotation Zrotation", 9, "3 rotations"),
    "two positions": ("6 Xposition Yposition Zposition", "5 Xposition Yposition", 5, "3 positions"),
    "a joint in an end": ("      OFFSET 50 0 0\n", "      OFFSET 50 0 0\n      JOINT x\n", 13, "found 'JOINT x'"),
    "unknown words": ("    End Site", "    Start Site", 10, "found 'Start Site'"),
    "no number of frames": ("Frames: 2", "Frames:", 17, "a whole number of frames"),
    "half a frame": ("Frames: 2", "Frames: 1.5", 17, "a whole number of frames"),
    "no frames": ("Frames: 2", "Frames: 0", 17, "a whole number of frames"),
    "endless frames": ("Frames: 2", "Frames: 1e999999", 17, "a whole number of frames"),
    "no frame time": ("Frame Time: 0.0333333\n", "", 18, "'Frame Time:' and seconds a frame"),
    "frame time nought": ("Time: 0.0333333", "Time: 0", 18, "seconds a frame, found 'Frame Time: 0'"),
    "frame time is no number": ("Time: 0.0333333", "Time: nan", 18, "seconds a frame"),
    "frame time of an hour": ("Time: 0.0333333", "Time: 3600", 18, "between 0.00001 and 10 s"),
    "a frame too few": ("Frames: 2", "Frames: 3", 20, "expected 3 lines of frames after the header, found 2"),
    "a frame too many": ("Frames: 2", "Frames: 1", 20, "expected 1 lines"),
    "an empty line among the frames": ("9\n1", "9\n\n1", 21, "expected 2 lines of frames"),
    "a truncated frame": ("7 8 9\n1 2 3 4 5 6 7 8 9", "7 8 9\n1 2 3 4 5", 20, "9 values for frame 2, found 5"),
    "a value too many": ("7 8 9\n1", "7 8 9 10\n1", 19, "9 values for frame 1, found 10"),
    "a word among the numbers": ("7 8 9\n1", "7 x 9\n1", 19, "expected numbers for frame 1"),
    "not a number": ("7 8 9\n1", "7 nan 9\n1", 19, "expected numbers for frame 1"),
    "infinity": ("7 8 9\n1", "7 -inf 9\n1", 19, "expected numbers for frame 1"),
    "beyond any unit": ("7 8 9\n1", "7 1e300 9\n1", 19, "expected numbers for frame 1"),
    "Python's underscores": ("7 8 9\n1", "7 1_0 9\n1", 19, "expected numbers for frame 1"),
}


@pytest.mark.parametrize(("old", "new", "line", "sentence"), BAD_BVH.values(), ids=BAD_BVH)
def test_bvh(tmp_path, old, new, line, sentence):
    path = tmp_path / "bad.bvh"
    assert old in BVH
    path.write_text(BVH.replace(old, new, 1))
    refused(lambda: read_bvh(path), path, line, sentence)


def test_the_bvh_that_the_bad_ones_come_from_is_good(tmp_path):
    (tmp_path / "good.bvh").write_text(BVH)
    assert len(read_bvh(tmp_path / "good.bvh")) == 2


@pytest.mark.parametrize(
    ("frame_time", "rate_hz"),
    [("0.0333333", 30.0), ("0.033333", 30.0), ("0.0333", 30.0), ("3.33333e-02", 30.0), ("0.00833333", 120.0),
     ("0.033367", 1 / 0.033367), ("0.04", 25.0), ("0.5", 2.0), ("2.5", 0.4)],
)  # fmt: skip
def test_frame_time_is_read_to_its_digits(tmp_path, frame_time, rate_hz):
    (tmp_path / "r.bvh").write_text(BVH.replace("0.0333333", frame_time))
    assert read_bvh(tmp_path / "r.bvh").rate_hz == pytest.approx(rate_hz, rel=1e-12)


def test_unit_is_cm_or_m(tmp_path):
    (tmp_path / "good.bvh").write_text(BVH)
    with pytest.raises(InputError, match="one of cm, m, found 'inch'"):
        read_bvh(tmp_path / "good.bvh", unit="inch")


ASF = """:units
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    name thigh
    direction 0 -1 0
    length 7
    axis 0 0 20 XYZ
    dof rx ry
  end
  begin
    name shin
    direction 0 -1 0
    length 7
    axis 0 0 20 XYZ
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""
AMC = """# comment
:FULLY-SPECIFIED
:DEGREES
5
root 0 0 0 0 0 0
thigh 1 2
6
root 0 0 0 0 0 0
thigh 1 2
"""

BAD_ASF = {
    "empty": (ASF, "", 1, ":bonedata and :hierarchy"),
    "cut in the bones": (ASF[ASF.index("    name shin") :], "", 17, "before the end of the file"),
    "cut before the hierarchy": (ASF[ASF.index(":hier") :], "", 22, ":bonedata and :hierarchy"),
    "length is no number": ("length 0.45", "length long", 2, "numbers for the unit of length"),
    "length nought": ("length 0.45", "length 0", 2, "a positive unit of length"),
    "gradians": ("angle deg", "angle grad", 3, "deg or rad, found 'grad'"),
    "a root without turns": ("TX TY TZ RX RY RZ", "TX TY TZ", 5, "TX TY TZ RX RY RZ in any order"),
    "a root's channel twice": ("TX TY TZ RX RY RZ", "TX TX TZ RX RY RZ", 5, "each once"),
    "a root's strange axis": ("axis XYZ\n  position", "axis XXZ\n  position", 6, "an order of axes such as XYZ"),
    "a displaced root": ("position 0 0 0", "position 0 1 0", 7, "position 0 0 0, found '0 1 0'"),
    "a turned root": ("orientation 0 0 0", "orientation 90 0 0", 8, "orientation 0 0 0"),
    "no channels of the root": ("  order TX TY TZ RX RY RZ\n", "", 26, "order of the root's channels"),
    "no begin": ("  begin\n    name thigh", "    name thigh", 10, "expected the begin of a bone"),
    "no end": ("  end\n  begin\n    name shin", "  begin\n    name shin", 16, "expected the end of bone 'thigh'"),
    "no name": ("    name thigh\n", "", 15, "a name of its own, found ''"),
    "a name twice": ("name shin", "name thigh", 22, "a name of its own, found 'thigh'"),
    "no direction": ("    direction 0 -1 0\n    length 7\n    axis 0 0 20 XYZ\n    dof", "    length 7\n    dof", 14,
                     "a direction, an axis and a length"),
    "a direction of length 2": ("direction 0 -1 0", "direction 0 -2 0", 16, "found one of length 2"),
    "a negative length": ("length 7", "length -7", 16, "not negative"),
    "a bone that stretches": ("dof rx ry", "dof rx l", 15, "some of rx ry rz"),
    "a bone's turn twice": ("dof rx ry", "dof rx rx", 15, "each once"),
    "a strange property": ("    length 7", "    colour 7", 13, "found 'colour'"),
    "an unknown bone": ("root thigh", "root hip", 25, "expected bones of :bonedata, found 'hip'"),
    "two parents": ("    thigh shin\n", "    thigh shin\n    root shin\n", 27, "one parent of shin"),
    "a circle": ("root thigh\n    thigh shin", "thigh shin\n    shin thigh", 27, "to hang from the root"),
    "a loose bone": ("    thigh shin\n", "", 26, "expected shin to hang from the root"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "sentence"), BAD_ASF.values(), ids=BAD_ASF)
def test_asf(tmp_path, old, new, line, sentence):
    path = tmp_path / "5.asf"
    assert old in ASF
    path.write_text(ASF.replace(old, new, 1))
    (tmp_path / "5_01.amc").write_text(AMC)
    refused(lambda: read_asf(path), path, line, sentence)
    refused(lambda: read_amc(tmp_path / "5_01.amc"), path, line, sentence)


BAD_AMC = {
    "empty": (AMC, "", 1, "expected frames, found none"),
    "no frames": (AMC[AMC.index("5\n") :], "", 3, "expected frames, found none"),
    "a bone before the first frame": ("5\nroot", "root", 4, "the number of a frame, found 'root"),
    "an unknown keyword": (":DEGREES", ":GRADIANS", 3, ":DEGREES, :RADIANS or :FULLY-SPECIFIED"),
    "a keyword among the frames": ("6\nroot", ":RADIANS\n6\nroot", 7, "a bone or a frame's number"),
    "a missing bone": ("thigh 1 2\n6", "6", 6, "the rest of frame 5, which lacks thigh"),
    "a truncated last frame": (
        "\n6\nroot 0 0 0 0 0 0\nthigh 1 2",
        "\n6\nroot 0 0 0 0 0 0",
        8,
        "frame 6, which lacks thigh",
    ),
    "truncated in a line": ("0\nthigh 1 2\n6", "0\nthigh 1\n6", 6, "2 values for thigh in frame 5, found 1"),
    "a value too many": ("0\nthigh 1 2\n6", "0\nthigh 1 2 3\n6", 6, "2 values for thigh in frame 5, found 3"),
    "an unknown bone": ("thigh 1 2\n6", "hip 1 2\n6", 6, "in the skeleton, found 'hip' in frame 5"),
    "a bone that does not turn": ("thigh 1 2\n6", "thigh 1 2\nshin 1\n6", 7, "in the skeleton, found 'shin'"),
    "a bone twice": ("thigh 1 2\n6", "thigh 1 2\nthigh 1 2\n6", 7, "thigh once in frame 5"),
    "not a number": ("thigh 1 2\n6", "thigh 1 -1.#IND\n6", 6, "expected numbers for thigh"),
    "frames that jump": ("\n6\n", "\n8\n", 7, "the number 6 of a frame, found '8'"),
    "frames that stand still": ("\n6\n", "\n5\n", 7, "the number 6 of a frame, found '5'"),
    "two numbers of a frame": ("\n6\n", "\n6 7\n", 7, "the number 6 of a frame, found '6 7'"),
    "an endless number": ("5\nroot", "9" * 5000 + "\nroot", 4, "the number of a frame"),
}


@pytest.mark.parametrize(("old", "new", "line", "sentence"), BAD_AMC.values(), ids=BAD_AMC)
def test_amc(tmp_path, old, new, line, sentence):
    path = tmp_path / "5_01.amc"
    assert old in AMC
    (tmp_path / "5.asf").write_text(ASF)
    path.write_text(AMC.replace(old, new, 1))
    refused(lambda: read_amc(path), path, line, sentence)


def test_the_acclaim_files_that_the_bad_ones_come_from_are_good(tmp_path):
    (tmp_path / "5.asf").write_text(ASF)
    (tmp_path / "5_01.amc").write_text(AMC)
    clip = read_amc(tmp_path / "5_01.amc")
    assert (len(clip), clip.first_frame) == (2, 5)
    (tmp_path / "elsewhere.asf").write_text(ASF.replace("length 7", "length 14"))
    longer = read_amc(tmp_path / "5_01.amc", asf=tmp_path / "elsewhere.asf")
    assert longer.offsets == pytest.approx(2 * clip.offsets)
    with pytest.raises(InputError, match="the rate must be"):
        read_amc(tmp_path / "5_01.amc", rate_hz=0.0)


@pytest.mark.parametrize("name", ["no.bvh", "no_1.amc", "no.asf"])
def test_a_missing_file(tmp_path, name):
    read = {"bvh": read_bvh, "amc": read_amc, "asf": read_asf}[name[-3:]]
    with pytest.raises(InputError, match=rf"{name}: no such file$"):
        read(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=rf"{name}: expected a file, found a folder"):
        read(tmp_path / name)


def test_a_missing_skeleton(tmp_path):
    (tmp_path / "5_01.amc").write_text(AMC)
    with pytest.raises(InputError, match=r"5\.asf: no such file$"):
        read_amc(tmp_path / "5_01.amc")


@pytest.mark.parametrize("read", [read_bvh, read_asf])
def test_a_binary_file(tmp_path, read):
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="binary: expected a text file"):
        read(tmp_path / "binary")


def refused(read, path, line, sentence):
    with pytest.raises(InputError) as refusal:
        read()
    assert str(refusal.value).startswith(f"{path}, line {line}: ")
    assert sentence in str(refusal.value)
    assert "\n" not in str(refusal.value)
