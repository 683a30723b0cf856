"""ASF and AMC files: damage is refused with the file and the line."""

import pytest
from damage import refusal, withstands
from sound_files import AMC, ASF, written

from workbench.motion.formats.asf_amc import read_amc

BAD_ASF = {
    "empty": (ASF, "", 1, ":bonedata and :hierarchy"),
    "cut in the bones": (ASF[ASF.index("    name shin") :], "", 17, "before the end of the file"),
    "length is no number": ("length 0.45", "length long", 2, "numbers for the unit of length"),
    "gradians": ("angle deg", "angle grad", 3, "deg or rad, found 'grad'"),
    "a root without turns": ("TX TY TZ RX RY RZ", "TX TY TZ", 5, "TX TY TZ RX RY RZ in any order"),
    "a root's strange axis": ("axis XYZ\n  position", "axis XXZ\n  position", 6, "an order of axes such as XYZ"),
    "a displaced root": ("position 0 0 0", "position 0 1 0", 7, "position 0 0 0, found '0 1 0'"),
    "no channels of the root": ("  order TX TY TZ RX RY RZ\n", "", 26, "order of the root's channels"),
    "no begin": ("  begin\n    name thigh", "    name thigh", 10, "expected the begin of a bone"),
    "a name twice": ("name shin", "name thigh", 22, "a name of its own, found 'thigh'"),
    "no direction": ("    direction 0 -1 0\n    length 7\n    axis 0 0 20 XYZ\n    dof", "    length 7\n    dof", 14,
                     "a direction, an axis and a length"),
    "a negative length": ("length 7", "length -7", 16, "not negative"),
    "a bone that stretches": ("dof rx ry", "dof rx l", 15, "some of rx ry rz"),
    "an unknown bone": ("root thigh", "root hip", 25, "expected bones of :bonedata, found 'hip'"),
    "a circle": ("root thigh\n    thigh shin", "thigh shin\n    shin thigh", 27, "to hang from the root"),
    "a loose bone": ("    thigh shin\n", "", 26, "expected shin to hang from the root"),
}  # fmt: skip
BAD_AMC = {
    "empty": (AMC, "", 1, "expected frames, found none"),
    "a bone before the first frame": ("5\nroot", "root", 4, "the number of a frame, found 'root"),
    "an unknown keyword": (":DEGREES", ":GRADIANS", 3, ":DEGREES, :RADIANS or :FULLY-SPECIFIED"),
    "a missing bone": ("thigh 1 2\n6", "6", 4, "the rest of frame 5, which lacks thigh"),
    "a truncated last frame": (
        "\n6\nroot 0 0 0 0 0 0\nthigh 1 2",
        "\n6\nroot 0 0 0 0 0 0",
        7,
        "frame 6, which lacks thigh",
    ),
    "truncated in a line": ("0\nthigh 1 2\n6", "0\nthigh 1\n6", 6, "2 values for thigh in frame 5, found 1"),
    "a value too many": ("0\nthigh 1 2\n6", "0\nthigh 1 2 3\n6", 6, "2 values for thigh in frame 5, found 3"),
    "an unknown bone": ("thigh 1 2\n6", "hip 1 2\n6", 6, "in the skeleton, found 'hip' in frame 5"),
    "a bone twice": ("thigh 1 2\n6", "thigh 1 2\nthigh 1 2\n6", 7, "thigh once in frame 5"),
    "not a number": ("thigh 1 2\n6", "thigh 1 -1.#IND\n6", 6, "expected numbers for thigh"),
    "frames that jump": ("\n6\n", "\n8\n", 7, "the number 6 of a frame, found '8'"),
    "an endless number": ("5\nroot", "9" * 5000 + "\nroot", 4, "the number of a frame"),
}  # what: (old, new, line, part of the message)


def test_random_damage_of_a_skeleton(tmp_path):
    amc = written(tmp_path / "5_01.amc", AMC)
    withstands(lambda asf: read_amc(amc, asf), written(tmp_path / "5.asf", ASF), 200)


def test_random_damage_of_a_movement(tmp_path):
    written(tmp_path / "5.asf", ASF)
    withstands(read_amc, written(tmp_path / "5_01.amc", AMC), 200)


@pytest.mark.parametrize(("old", "new", "line", "message"), BAD_ASF.values(), ids=BAD_ASF)
def test_a_defect_of_a_skeleton_is_refused_with_its_line(tmp_path, old, new, line, message):
    assert old in ASF
    path, amc = written(tmp_path / "5.asf", ASF.replace(old, new, 1)), written(tmp_path / "5_01.amc", AMC)
    found = refusal(read_amc, amc)
    assert found.startswith(f"{path}, line {line}: ")
    assert message in found


@pytest.mark.parametrize(("old", "new", "line", "message"), BAD_AMC.values(), ids=BAD_AMC)
def test_a_defect_of_a_movement_is_refused_with_its_line(tmp_path, old, new, line, message):
    assert old in AMC
    written(tmp_path / "5.asf", ASF)
    path = written(tmp_path / "5_01.amc", AMC.replace(old, new, 1))
    found = refusal(read_amc, path)
    assert found.startswith(f"{path}, line {line}: ")
    assert message in found


def test_a_movement_without_its_skeleton(tmp_path):
    assert refusal(read_amc, written(tmp_path / "5_01.amc", AMC)).endswith("5.asf: no such file")
