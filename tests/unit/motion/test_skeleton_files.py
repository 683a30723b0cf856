"""BVH files with the joints, units, axes and grammar of other programs, all of the same walk."""

import logging

import numpy as np
import pytest
from skeleton_files import STYLES, walk, walk_bvh

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.motion.formats.bvh import bvh_text, read_bvh
from workbench.motion.formats.person_clip import _moving_rows
from workbench.motion.retarget import estimated_landmarks, retarget
from workbench.motion.sources import Reading, load_motion
from workbench.utils.errors import InputError

BODY = [k for k, name in enumerate(JOINT_NAMES) if name != "head_centre"]


def check_walk(motion):
    """Check that a motion is the walk by its lengths, its joints without the head, and its twists."""
    truth = walk()
    assert motion.rate_hz == 30.0
    assert motion.shape.thigh == pytest.approx(truth.shape.thigh, abs=1e-4)
    expected, positions = (joints(person_skeleton(one.shape), one.poses) for one in (truth, motion))
    np.testing.assert_allclose(positions[:, BODY], expected[:, BODY], atol=0.003)
    skeleton = person_skeleton(truth.shape)
    twists = [skeleton.dof(f"{side}_{joint}_twist") for side in ("left", "right") for joint in ("hip", "shoulder")]
    assert np.abs(motion.poses[:, twists] - truth.poses[:, twists]).max() < 0.12


@pytest.mark.parametrize("style", STYLES)
def test_skeletons_of_other_programs_are_imported(tmp_path, style):
    """The axes of the joints' frames are random; the rest pose is not one of a person."""
    check_walk(load_motion(walk_bvh(tmp_path, style, seed=3)))


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_hinge_axes_are_estimated_in_any_frame(tmp_path, seed):
    clip = read_bvh(walk_bvh(tmp_path, seed=seed))
    landmarks = estimated_landmarks(clip)
    for name, left in landmarks.lefts.items():
        assert np.linalg.norm(left) == pytest.approx(1.0)
        assert seed is not None or left[1] > 0.9, name  # in our frames y is left
    check_walk(retarget(clip, landmarks))


@pytest.mark.parametrize(
    ("unit", "per_metre", "up"),
    [
        ("m", 1.0, "z"), ("cm", 100.0, "y"), ("cm", 100.0, "z"), ("mm", 1000.0, "y"), ("inch", 1 / 0.0254, "z"),
        ("cmu", 0.45 / 0.0254, "y"),
    ],
)  # fmt: skip
def test_unit_and_vertical_axis_are_those_of_a_person(tmp_path, caplog, unit, per_metre, up):
    caplog.set_level(logging.INFO)
    path = walk_bvh(tmp_path, unit=per_metre, up=up, seed=1)
    check_walk(load_motion(path))
    assert f"read in {unit}" in caplog.text
    warnings = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert len(warnings) == (unit != "cm") + (up != "y")
    caplog.clear()
    check_walk(load_motion(path, Reading(unit=unit, up=up)))
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_an_impossible_size_is_rejected_with_the_key(tmp_path):
    with pytest.raises(InputError, match=r"expected a person of .* m.*give the unit"):
        load_motion(walk_bvh(tmp_path, unit=30_000.0))


def test_our_export_is_imported(tmp_path):
    motion = walk()
    for unit in ("cm", "m"):
        path = tmp_path / f"{unit}.bvh"
        path.write_text(bvh_text(person_skeleton(motion.shape), motion.poses, motion.rate_hz, unit))
        imported = load_motion(path)
        check_walk(imported)
        heads = [joints(person_skeleton(one.shape), one.poses)[:, JOINT_NAMES.index("head_centre")]
                 for one in (motion, imported)]  # fmt: skip
        np.testing.assert_allclose(*heads, atol=0.003)


def prop(text):
    """Return the text with a prop before the person."""
    head = "ROOT Prop\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n}\n"
    start = text.index("Frame Time: 0.0333333\n") + len("Frame Time: 0.0333333\n")
    body = "".join(f"1 2 3 4 5 6 {row}\n" for row in text[start:].splitlines())
    return "HIERARCHY\n" + head + text[len("HIERARCHY\n") : start] + body


VARIANTS = {
    "blank lines": lambda text: text.replace("MOTION\n", "\nMOTION\n\n").replace("\nFrame Time", "\n\nFrame Time"),
    "more rows": lambda text: text.replace("Frames: 61", "Frames: 60"),
    "fewer rows": lambda text: text.replace("Frames: 61", "Frames: 62"),
    "lower case": lambda text: text.replace("rotation", "ROTATION").lower().replace("hips", "Hips"),
    "decimal commas": lambda text: text.replace(".", ","),
    "CRLF and a byte-order mark": lambda text: "\ufeff" + text.replace("\n", "\r\n"),
    "UTF-8 names": lambda text: text.replace("Hips", "Hüfte"),
    "two roots": prop,
    "two people": lambda text: prop(text).replace("Prop", "Hips"),
    "two end sites": lambda text: text.replace("}\n}\nJOINT", "}\nEnd Site\n{\nOFFSET 1 0 0\n}\n}\nJOINT", 1),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_variants_of_the_grammar_are_read(tmp_path, variant):
    check_walk(load_motion(walk_bvh(tmp_path, lines=VARIANTS[variant])))


def test_windows_1252_is_read(tmp_path):
    path = walk_bvh(tmp_path, lines=lambda text: text.replace("Hips", "Hüfte"))
    path.write_bytes(path.read_text(encoding="utf-8").encode("cp1252"))
    check_walk(load_motion(path))


def test_a_hinge_can_have_a_single_rotation(tmp_path):
    """In the walk's frames a knee rotates about the file's x only."""

    def hinge(text):
        head, motion = text.split("MOTION")
        column, lines, knees = 0, [], []
        for line in head.splitlines():
            if line.startswith("CHANNELS"):
                is_knee = "Leg" in lines[-3] and "Up" not in lines[-3]
                knees += [column + 3 * line.startswith("CHANNELS 6")] * is_knee
                column += int(line.split()[1])
                line = "CHANNELS 1 Xrotation" if is_knee else line
            lines.append(line)
        count, time, *frames = motion.strip().split("\n")
        unused = {column for knee in knees for column in (knee, knee + 2)}  # of Z, X and Y
        frames = [" ".join(x for k, x in enumerate(row.split()) if k not in unused) for row in frames]
        assert len(knees) == 2
        return "\n".join([*lines, "MOTION", count, time, *frames, ""])

    check_walk(load_motion(walk_bvh(tmp_path, lines=hinge)))


def test_missing_values_repeat_the_last_ones(tmp_path, caplog):
    def gap(text):
        lines = text.split("\n")
        first = lines.index("Frame Time: 0.0333333") + 1
        lines[first + 5] = " ".join(["nan"] * len(lines[first].split()))
        return "\n".join(lines)

    clip, complete = read_bvh(walk_bvh(tmp_path, lines=gap)), read_bvh(walk_bvh(tmp_path))
    np.testing.assert_array_equal(clip.positions[5], complete.positions[4])
    np.testing.assert_array_equal(clip.positions[6:], complete.positions[6:])
    assert "1 of 61 frames lack values" in caplog.text


def test_other_names_are_mapped_by_landmarks(tmp_path):
    path = walk_bvh(tmp_path, lines=lambda text: text.replace("LeftLeg", "Anna Knie links"))
    with pytest.raises(InputError, match="found no joint for left_knee; name them by the key landmarks"):
        load_motion(path)
    check_walk(load_motion(path, Reading(landmarks={"left_knee": "Anna Knie links"})))
    for landmarks in ({"tail": "Hips"}, {"left_knee": "Tail"}):
        with pytest.raises(InputError, match=r"landmarks: .*[Tt]ail"):
            load_motion(path, Reading(landmarks=landmarks))


def test_a_person_lying_along_x_needs_the_vertical_axis(tmp_path):
    def lying(text):
        """Return the text with the walk in a frame of the laboratory that is turned by 90°."""
        head, motion = text.split("Frame Time: 0.0333333\n")
        hips = "ROOT Hips\n{\nOFFSET 0.000000 0.000000 0.000000\n"
        lab = "ROOT Lab\n{\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\n" + hips.replace("ROOT", "JOINT")
        assert hips in head
        head = head.replace(hips, lab).replace("MOTION", "}\nMOTION")
        return head + "Frame Time: 0.0333333\n" + "".join(f"-90 {row}\n" for row in motion.splitlines())

    path = walk_bvh(tmp_path, lines=lying)
    with pytest.raises(InputError, match=r"along x in 100% of the frames; if the person lies, give the vertical axis"):
        load_motion(path)
    lying_walk, standing_walk = (load_motion(path, Reading(up=up)) for up in ("y", "x"))
    expected = joints(person_skeleton(walk().shape), walk().poses)[:, BODY, 2]
    for motion, axis in ((lying_walk, 1), (standing_walk, 2)):  # the file's x is the world's y if its y is up
        coordinates = joints(person_skeleton(motion.shape), motion.poses)[:, BODY, axis]
        np.testing.assert_allclose(coordinates, expected, atol=0.003)


@pytest.mark.parametrize(
    ("n_first", "n_last", "rate_hz"), [(1, 0, 30.0), (3, 0, 30.0), (1, 0, 120.0), (0, 2, 30.0), (1, 1, 30.0)]
)
def test_rows_in_the_rest_pose_at_either_end_are_left_out(tmp_path, caplog, n_first, n_last, rate_hz):
    """Public BVH conversions of the CMU database begin with a row of zeros."""

    def with_rest(text):
        head, rows = text.split("Frame Time: 0.0333333\n")
        zeros = " ".join(["0.0"] * len(rows.split("\n")[0].split()))
        rest = f"{zeros}\n"
        return f"{head}Frame Time: {1.0 / rate_hz:.7f}\n" + n_first * rest + rows + n_last * rest

    path = walk_bvh(tmp_path, lines=with_rest)
    clip = read_bvh(path)
    expected = read_bvh(walk_bvh(tmp_path))
    assert len(clip) == len(expected)
    np.testing.assert_allclose(clip.positions, expected.positions, atol=1e-9)
    assert "no motion" in caplog.text


@pytest.mark.parametrize("step", [1, -1])
@pytest.mark.parametrize(("ratio", "is_left_out"), [(1.9, False), (2.1, True)])
def test_the_rest_pose_is_no_motion_if_it_is_twice_as_fast_as_any_motion(ratio, is_left_out, step):
    rotations = np.broadcast_to(np.eye(3), (4, 1, 3, 3)).copy()
    rotations[1:] = np.diag([-1.0, -1.0, 1.0])
    positions = np.zeros((4, 1, 3))
    positions[:, 0, 0] = [0.0, ratio, ratio + 1.0, ratio + 2.0]
    first, end = _moving_rows("a.bvh", 1.0, rotations[::step], positions[::step])
    assert (first, 4 - end)[::step] == (int(is_left_out), 0)


@pytest.mark.parametrize("step", [1, -1])
@pytest.mark.parametrize(("speed", "is_left_out"), [(39.0, False), (41.0, True)])
def test_a_row_is_no_motion_if_joints_leave_it_faster_than_a_hand_can(speed, is_left_out, step):
    positions = np.zeros((4, 1, 3))
    positions[1:, 0, 0] = speed
    first, end = _moving_rows("a.bvh", 1.0, np.full((4, 1, 3, 3), 0.5), positions[::step])
    assert (first, 4 - end)[::step] == (int(is_left_out), 0)


@pytest.mark.parametrize("name", ["End Site_tip", "End Site HeadTop", "End", "EndSite"])
def test_end_sites_may_have_names(tmp_path, name):
    expected = read_bvh(walk_bvh(tmp_path))
    clip = read_bvh(walk_bvh(tmp_path, lines=lambda text: text.replace("End Site", name)))
    assert clip.joints == expected.joints
