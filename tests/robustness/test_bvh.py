"""BVH files: damage is refused with the file and the line."""

import pytest
from damage import refusal, withstands
from sound_files import BVH, written

from workbench.motion.formats.bvh import read_bvh
from workbench.utils.input_limits import MOST_JOINTS

BAD = {
    "empty": (BVH, "", 1, "expected HIERARCHY"),
    "only the hierarchy": (BVH[BVH.index("MOTION") :], "", 15, "expected MOTION, found the end of the file"),
    "a brace too few": ("  }\n}\nMOTION", "}\nMOTION", 15, "closing brace"),
    "no brace after a joint": ("JOINT arm\n  {", "JOINT arm", 7, "expected {, found 'OFFSET"),
    "a joint without name": ("JOINT arm", "JOINT", 6, "a new joint's name"),
    "a name twice": ("JOINT arm", "JOINT hips", 6, "a new joint's name, found 'hips'"),
    "no offset": ("    OFFSET 0 100 0\n", "", 13, "OFFSET and CHANNELS of arm"),
    "a word in an offset": ("OFFSET 0 100 0", "OFFSET 0 up 0", 8, "found '0 up 0'"),
    "a wrong count of channels": ("CHANNELS 3", "CHANNELS 4", 9, "3 rotations"),
    "no number of frames": ("Frames: 2", "Frames:", 17, "a whole number of frames"),
    "no frames": ("Frames: 2", "Frames: 0", 17, "a whole number of frames"),
    "no frame time": ("Frame Time: 0.0333333\n", "", 18, "'Frame Time:' and seconds a frame"),
    "frame time nought": ("Time: 0.0333333", "Time: 0", 18, "seconds a frame, found 'Frame Time: 0'"),
    "frame time of an hour": ("Time: 0.0333333", "Time: 3600", 18, "between 0.00001 and 10 s"),
    "a frame too few": ("Frames: 2", "Frames: 3", 20, "expected 3 lines of frames after the header, found 2"),
    "an empty line among the frames": ("9\n1", "9\n\n1", 21, "expected 2 lines of frames"),
    "a truncated frame": ("7 8 9\n1 2 3 4 5 6 7 8 9", "7 8 9\n1 2 3 4 5", 20, "9 values for frame 2, found 5"),
    "a word among the numbers": ("7 8 9\n1", "7 x 9\n1", 19, "expected numbers for frame 1"),
    "not a number": ("7 8 9\n1", "7 nan 9\n1", 19, "expected numbers for frame 1"),
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
