"""BVH files: damage is refused with the file and the line."""

import pytest
from damage import refusal, withstands
from sound_files import BVH, written

from workbench.limits import MOST_JOINTS
from workbench.mocap.bvh import read_bvh

BAD = {
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
}  # what: (old, new, line, part of the message)


def test_random_damage(tmp_path):
    withstands(read_bvh, written(tmp_path / "a.bvh", BVH), 200)


@pytest.mark.parametrize(("old", "new", "line", "message"), BAD.values(), ids=BAD)
def test_a_defect_is_refused_with_its_line(tmp_path, old, new, line, message):
    assert old in BVH
    path = written(tmp_path / "a.bvh", BVH.replace(old, new, 1))
    found = refusal(read_bvh, path)
    assert found.startswith(f"{path}, line {line}: ")
    assert message in found


def test_more_joints_than_any_skeleton(tmp_path):
    joints = "".join(f"JOINT j{k}\n{{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Zrotation Yrotation\n" for k in range(20_000))
    path = written(tmp_path / "a.bvh", BVH.replace("  JOINT arm", f"{joints}  JOINT arm"))
    assert f"at most {MOST_JOINTS} joints" in refusal(read_bvh, path)


def test_positions_beyond_the_earth(tmp_path):
    path = written(tmp_path / "a.bvh", BVH.replace("1 2 3 4", "1e11 2 3 4"))
    assert "expected positions up to 1e+07 m, found 1e+09 m" in refusal(read_bvh, path)


def test_bytes_that_are_no_text(tmp_path):
    assert "a.bvh: expected a text file" in refusal(read_bvh, written(tmp_path / "a.bvh", bytes(range(256))))
