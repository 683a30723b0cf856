"""Markers from TRC and C3D files: unit, axes, gaps, joints, and what is refused."""

import logging

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.formats.markers import in_world, joint_centres, joints_of, read_markers
from workbench.motion.formats.motion_export import trc_text
from workbench.motion.formats.trc import RawMarkers
from workbench.utils.errors import InputError

BODY = person(from_height(1.75))


def places(n=4):
    poses = np.zeros((n, 25))
    poses[:, 0], poses[:, 2] = np.linspace(0.0, 0.3, n), 0.93
    poses[:, BODY.skeleton.dof("left_knee_flexion")] = np.linspace(0.0, 1.0, n)
    return joints(BODY.skeleton, poses)


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_what_is_written_as_trc_is_read_back(tmp_path, unit):
    truth = places()
    truth[2, 5] = np.nan
    (tmp_path / "a.trc").write_text(trc_text("a.trc", JOINT_NAMES, truth, 50.0, unit))
    markers = read_markers(tmp_path / "a.trc")
    assert (markers.names, markers.rate_hz) == (JOINT_NAMES, 50.0)
    np.testing.assert_allclose(joint_centres(markers, markers.positions), truth, atol=1e-7)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
@pytest.mark.parametrize("up", ["y", "z"])
def test_unit_and_axes_are_told_by_the_person_whatever_the_header_says(unit, factor, up, caplog):
    caplog.set_level(logging.INFO)
    truth = places()
    given = truth if up == "z" else truth[..., [1, 2, 0]]
    markers = in_world("file", RawMarkers(JOINT_NAMES, 50.0, factor * given, "mm"))
    np.testing.assert_allclose(markers.positions, truth, atol=1e-12)
    assert f"read in {unit}" in caplog.text
    assert f"{up} is up" in caplog.text
    assert ("by the file it would be mm" in caplog.text) == (unit != "mm")


def test_blank_cells_are_gaps_also_at_a_line_s_end(tmp_path):
    names, truth = ["LShoulder", "LKnee"], places()[:, [3, 10]]
    lines = trc_text("a.trc", names, truth, 50.0, "m").split("\n")
    cells = lines[7].split("\t")
    lines[7] = "\t".join([*cells[:2], "", "", "", *cells[5:]])
    lines[8] = "\t".join(lines[8].split("\t")[:5])
    (tmp_path / "a.trc").write_text("\n".join(lines))
    found = read_markers(tmp_path / "a.trc").positions
    assert np.isnan(found[..., 0]).tolist() == [[False, False], [True, False], [False, True], [False, False]]


def test_joints_are_named_in_many_ways_and_made_of_several_markers():
    names = ("RHip", "L_Hip", "Neck", "Head", "left knee", "LANK_medial", "LANK_lateral", "RShoulder")
    positions = np.random.default_rng(0).standard_normal((3, len(names), 3))
    positions[:, [2, 3, 7], 2] += 9.0
    markers = in_world("file", RawMarkers(names, 50.0, positions / 5.0, "m"), "m")
    given = {"left_ankle": ["LANK_medial", "LANK_lateral"]}
    assert dict(joints_of(markers, given)) == {
        "pelvis": ("L_Hip", "RHip"), "neck": ("Neck",), "head_centre": ("Neck", "Head"), "left_hip": ("L_Hip",),
        "left_knee": ("left knee",), "left_ankle": ("LANK_medial", "LANK_lateral"), "right_hip": ("RHip",),
        "right_shoulder": ("RShoulder",),
    }  # fmt: skip
    centres = joint_centres(markers, markers.positions, given)
    np.testing.assert_allclose(centres[:, JOINT_NAMES.index("pelvis")], markers.positions[:, :2].mean(axis=1))
    assert np.isnan(centres[:, JOINT_NAMES.index("right_knee")]).all()
    for wrong in ({"tail": ["Neck"]}, {"neck": ["Tail"]}):
        with pytest.raises(InputError, match="ail"):
            joints_of(markers, wrong)


def test_positions_between_frames_are_linear_and_unknown_beside_gaps_and_outside():
    truth = places()
    truth[1, 4] = np.nan
    markers = in_world("file", RawMarkers(JOINT_NAMES, 50.0, truth, "m"))
    found = markers.at(np.array([0.0, 0.005, 0.04, 0.05, 0.06, 0.0601, -0.001]))
    np.testing.assert_allclose(found[0], truth[0])
    np.testing.assert_allclose(found[1, 3], 0.75 * truth[0, 3] + 0.25 * truth[1, 3])
    assert np.isnan(found[1, 4]).all()
    np.testing.assert_allclose(found[2], truth[2])
    np.testing.assert_allclose(found[3], 0.5 * (truth[2] + truth[3]))
    np.testing.assert_allclose(found[4], truth[3])
    assert np.isnan(found[5:]).all()


def test_c3d_is_read_as_trc_is(tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    truth = places()
    file, points = ezc3d.c3d(), np.ones((4, len(JOINT_NAMES), len(truth)))
    points[:3] = 1000.0 * truth.transpose(2, 1, 0)
    points[:3, 5, 2] = np.nan
    file["parameters"]["POINT"]["RATE"]["value"] = [50.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = JOINT_NAMES
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["data"]["points"] = points
    file.write(str(tmp_path / "a.c3d"))
    markers = read_markers(tmp_path / "a.c3d")
    truth[2, 5] = np.nan
    assert markers.rate_hz == 50.0
    np.testing.assert_allclose(joint_centres(markers, markers.positions), truth, atol=1e-6)  # it keeps 32 bits
    (tmp_path / "bad.c3d").write_bytes(b"no such thing")
    with pytest.raises(InputError, match=r"bad\.c3d: expected a C3D file"):
        read_markers(tmp_path / "bad.c3d")


def test_what_cannot_be_told_is_refused(tmp_path):
    truth = places()
    for positions, names, said in (
        (truth[..., [2, 0, 1]], JOINT_NAMES, "y or z to be up, but the head is above the feet along x"),
        (truth, tuple(f"M{j}" for j in range(15)), "give the vertical axis"),
        (np.full_like(truth, np.nan), JOINT_NAMES, "found none in 4 frames"),
    ):
        with pytest.raises(InputError, match=said):
            in_world("file", RawMarkers(names, 50.0, positions, "m"))
    with pytest.raises(InputError, match=r"the extension \.trc or \.c3d"):
        read_markers(tmp_path / "a.csv")
