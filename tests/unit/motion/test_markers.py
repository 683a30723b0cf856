"""Markers from TRC and C3D files: unit, axes, gaps and joints."""

import logging

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.formats.joint_names import marker_joints
from workbench.motion.formats.markers import Markers, frozen_markers, in_world, joint_centres, joints_of, read_markers
from workbench.motion.formats.motion_export import Track, export, trc_text
from workbench.motion.formats.trc import RawMarkers
from workbench.utils.errors import InputError

BODY = person(from_height(1.75))


def walking_joints(n=4):
    poses = np.zeros((n, 25))
    poses[:, 0], poses[:, 2] = np.linspace(0.0, 0.3, n), 0.93
    poses[:, BODY.skeleton.dof("left_knee_flexion")] = np.linspace(0.0, 1.0, n)
    return joints(BODY.skeleton, poses)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
@pytest.mark.parametrize("up", ["y", "z"])
def test_unit_and_axes_follow_from_the_person_and_not_from_the_header(unit, factor, up, caplog):
    caplog.set_level(logging.INFO)
    truth = walking_joints()
    positions = truth if up == "z" else truth[..., [1, 2, 0]]
    markers = in_world("file", RawMarkers(JOINT_NAMES, 50.0, factor * positions, "mm"))
    np.testing.assert_allclose(markers.positions, truth, atol=1e-12)
    assert f"read in {unit}" in caplog.text
    assert f"{up} is up" in caplog.text
    assert ("by the file it would be mm" in caplog.text) == (unit != "mm")


def test_blank_and_absent_cells_are_gaps(tmp_path):
    names, truth = ["LShoulder", "LKnee"], walking_joints()[:, [3, 10]]
    lines = trc_text("a.trc", names, truth, 50.0, "m").split("\n")
    cells = lines[7].split("\t")
    lines[7] = "\t".join([*cells[:2], "", "", "", *cells[5:]])
    lines[8] = "\t".join(lines[8].split("\t")[:5])
    (tmp_path / "a.trc").write_text("\n".join(lines))
    positions = read_markers(tmp_path / "a.trc").positions
    assert np.isnan(positions[..., 0]).tolist() == [[False, False], [True, False], [False, True], [False, False]]


def test_joints_have_many_names_and_can_be_means_of_several_markers():
    names = ("RHip", "L_Hip", "Neck", "Head", "left knee", "LANK_medial", "LANK_lateral", "RShoulder")
    positions = np.random.default_rng(0).standard_normal((3, len(names), 3))
    positions[:, [2, 3, 7], 2] += 9.0
    markers = in_world("file", RawMarkers(names, 50.0, positions / 5.0, "m"), "m")
    chosen = {"left_ankle": ["LANK_medial", "LANK_lateral"]}
    assert dict(joints_of(markers, chosen)) == {
        "pelvis": ("L_Hip", "RHip"), "neck": ("Neck",), "head_centre": ("Neck", "Head"), "left_hip": ("L_Hip",),
        "left_knee": ("left knee",), "left_ankle": ("LANK_medial", "LANK_lateral"), "right_hip": ("RHip",),
        "right_shoulder": ("RShoulder",),
    }  # fmt: skip
    centres = joint_centres(markers, markers.positions, chosen)
    np.testing.assert_allclose(centres[:, JOINT_NAMES.index("pelvis")], markers.positions[:, :2].mean(axis=1))
    assert np.isnan(centres[:, JOINT_NAMES.index("right_knee")]).all()
    for wrong in ({"tail": ["Neck"]}, {"neck": ["Tail"]}):
        with pytest.raises(InputError, match="ail"):
            joints_of(markers, wrong)


def test_positions_are_interpolated_linearly_and_missing_near_gaps_and_outside():
    truth = walking_joints()
    truth[1, 4] = np.nan
    markers = in_world("file", RawMarkers(JOINT_NAMES, 50.0, truth, "m"))
    positions = markers.at(np.array([0.0, 0.005, 0.04, 0.05, 0.06, 0.0601, -0.001]))
    np.testing.assert_allclose(positions[0], truth[0])
    np.testing.assert_allclose(positions[1, 3], 0.75 * truth[0, 3] + 0.25 * truth[1, 3])
    assert np.isnan(positions[1, 4]).all()
    np.testing.assert_allclose(positions[2], truth[2])
    np.testing.assert_allclose(positions[3], 0.5 * (truth[2] + truth[3]))
    np.testing.assert_allclose(positions[4], truth[3])
    assert np.isnan(positions[5:]).all()


@pytest.mark.parametrize(("n_frozen", "is_frozen"), [(8, True), (7, False)])
@pytest.mark.parametrize("n_still", [1, 2])
def test_a_marker_that_alone_stands_still_in_most_steps_is_omitted(n_frozen, is_frozen, n_still, caplog):
    positions = walking_joints(16)  # 15 steps
    still = [JOINT_NAMES.index(name) for name in ("left_wrist", "right_wrist")[:n_still]]
    positions[5 : 6 + n_frozen, still] = positions[5, still]
    markers = in_world("file", RawMarkers(JOINT_NAMES, 50.0, positions, "m"))
    omitted = [name for name in JOINT_NAMES if name not in markers.names]
    assert omitted == ["left_wrist"] * (is_frozen and n_still == 1)
    assert ("marker left_wrist stands still" in caplog.text) == bool(omitted)


def test_a_short_clip_shows_no_frozen_marker():
    positions = np.random.default_rng(0).standard_normal((11, 3, 3))
    positions[:, 1] = 0.3
    assert frozen_markers(positions).tolist() == [False, True, False]
    assert not frozen_markers(positions[1:]).any()


def test_ambiguous_axes_empty_files_and_other_extensions_are_rejected(tmp_path):
    truth = walking_joints()
    for positions, names, message in (
        (truth[..., [2, 0, 1]], JOINT_NAMES, "y or z to be up, but the head is above the feet along x"),
        (truth, tuple(f"M{j}" for j in range(15)), "give the vertical axis"),
        (np.full_like(truth, np.nan), JOINT_NAMES, "found none in 4 frames"),
    ):
        with pytest.raises(InputError, match=message):
            in_world("file", RawMarkers(names, 50.0, positions, "m"))
    with pytest.raises(InputError, match=r"the extension \.trc or \.c3d"):
        read_markers(tmp_path / "a.txt")


def test_an_exported_table_is_read_back(tmp_path):
    truth = walking_joints()
    truth[2, 5] = np.nan
    track = Track(BODY.skeleton, np.array([7, 8, 11, 12]), np.array([7, 8, 11, 12]) / 30.0, truth, np.zeros((4, 25)))
    export(tmp_path / "a.csv", track)
    markers = read_markers(tmp_path / "a.csv")
    assert (markers.names, markers.rate_hz, len(markers.positions)) == (JOINT_NAMES, 30.0, 6)
    np.testing.assert_allclose(markers.positions[[0, 1, 4, 5]], truth, atol=0.51e-9)
    assert np.isnan(markers.positions[2:4]).all()
    (tmp_path / "b.csv").write_text("frame,time_s\n1,2\n")
    with pytest.raises(InputError, match=r"b.csv, line 1: expected the columns frame, time_s"):
        read_markers(tmp_path / "b.csv")


def c3d_file(path, labels, positions, unit="mm", **parameters):
    """Write markers at positions (F, M, 3) in a unit, with further parameters of POINT; return the path."""
    ezc3d = pytest.importorskip("ezc3d")
    file, points = ezc3d.c3d(), np.ones((4, positions.shape[1], len(positions)))
    points[:3] = positions.transpose(2, 1, 0)
    file["parameters"]["POINT"]["RATE"]["value"] = [50.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(labels)
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    for key, value in parameters.items():
        file.add_parameter("POINT", key, value)
    file["data"]["points"] = points
    file.write(str(path))
    return path


def joints_in(path, **reading):
    markers = read_markers(path, **reading)
    return joint_centres(markers, markers.positions)


def test_model_outputs_and_force_plates_do_not_change_unit_and_axes(tmp_path):
    """Angles and moments are far larger than the person; a force plate is 9 m away."""
    truth = walking_joints()
    outputs = np.tile([[3e4, 1.0, -5e4], [9.0, 9.0, 0.0], [20.0, 9e5, 7.0]], (4, 1, 1))
    labels = [*[f"Anna:{name}" for name in JOINT_NAMES], "Anna:LKneeMoment", "FP0", "Anna:Custom"]
    for unit, per_metre in (("mm", 1000.0), ("m", 1.0)):
        points = np.concatenate([per_metre * truth, outputs], axis=1)
        path = c3d_file(tmp_path / "a.c3d", labels, points, unit, SCALARS=["Anna:Custom"])
        markers = read_markers(path)
        assert markers.names == (*labels[:-3], "FP0")
        np.testing.assert_allclose(joint_centres(markers, markers.positions), truth, atol=1e-6)


def test_c3d_files_can_have_many_labels_gaps_and_a_vertical_axis(tmp_path, caplog):
    truth = walking_joints()
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-1.0, 1.0, (4, 260, 3)), truth], axis=1)
    points[2, 265] = 0.0
    path = c3d_file(tmp_path / "a.c3d", [*[f"M{k}" for k in range(260)], *JOINT_NAMES], 1000.0 * points)
    expected = truth.copy()
    expected[2, 5] = np.nan
    np.testing.assert_allclose(joints_in(path), expected, atol=1e-6)
    turned = truth[..., [1, 2, 0]]
    for y_screen in ("+Y", "-Z"):  # a header that contradicts the person is ignored
        caplog.clear()
        path = c3d_file(tmp_path / "b.c3d", JOINT_NAMES, 1000.0 * turned, X_SCREEN=["+X"], Y_SCREEN=[y_screen])
        np.testing.assert_allclose(joints_in(path), truth, atol=1e-6)
        assert ("y is taken to be up" in caplog.text) == (y_screen == "-Z")


@pytest.mark.parametrize(
    "names",
    [
        {"left_knee": "LKNE", "left_ankle": "LANK", "left_shoulder": "LSHO", "left_elbow": "LELB", "neck": "C7"},
        {"left_knee": "L.Knee", "left_ankle": "L.Ankle", "left_shoulder": "L.Acromium", "neck": "C7"},
        {"left_knee": "left_knee", "left_hip": "left_hip", "neck": "neck_center", "pelvis": "hips_center"},
        {"left_hip": "V_L.Hip_JC", "left_knee": "V_L.Knee_JC", "left_ankle": "V_L.Ankle_JC"},
        {"left_hip": "LHJC", "left_knee": "LKJC", "left_ankle": "LAJC"},
    ],
)
def test_marker_sets_are_recognized(names):
    joints_by_markers = marker_joints([f"Skeleton 1:{name}" for name in names.values()])
    assert {joint: joints_by_markers[joint] for joint in names} == {
        j: (f"Skeleton 1:{name}",) for j, name in names.items()
    }


def test_markers_on_both_sides_of_a_joint_are_preferred_and_people_are_separated(caplog):
    pairs = ["LKneeOut", "LKneeIn", "LLFC", "LMFC", "LWRA", "LWRB", "RKNE", "R.Knee.Medial", "R.Knee"]
    joints_by_markers = marker_joints(pairs)
    assert joints_by_markers["left_knee"] == ("LKneeOut", "LKneeIn")
    assert joints_by_markers["left_wrist"] == ("LWRA", "LWRB")
    assert joints_by_markers["right_knee"] == ("R.Knee", "R.Knee.Medial")
    assert not [record for record in caplog.records if record.levelname == "WARNING"]
    joints_by_markers = marker_joints([f"{person}:{name}" for person in ("Anna", "Bob") for name in JOINT_NAMES])
    assert {name.split(":")[0] for names in joints_by_markers.values() for name in names} == {"Anna"}
    assert "markers of 2 people; used are those of Anna" in caplog.text


@pytest.mark.parametrize(
    ("names", "joints"),
    [
        (
            "R_knee R_mknee R_ankle R_mankle R_wrist_radius R_wrist_ulna",
            {"right_knee": 2, "right_ankle": 2, "right_wrist": 2},
        ),
        (
            "r_ankle_study r_mankle_study r_lelbow_study L_ankle_study L_lelbow_study r_melbow_study",
            {"right_ankle": 2, "right_elbow": 2, "left_ankle": 1},
        ),
        ("RHip RKnee RFoot LHip LKnee LFoot", {"right_ankle": 1, "left_ankle": 1}),
        ("neck head headtop", {"head_centre": 2}),
    ],
)
def test_pairs_of_markers_of_public_data_sets(names, joints):
    found = marker_joints(names.split())
    assert {joint: len(found[joint]) for joint in joints} == joints


def test_the_head_of_a_skeleton_is_a_joint_and_that_of_keypoints_the_vertex():
    names = ["Pelvis", "Neck", "Head", "L_Hip", "R_Hip"]
    assert marker_joints(names)["head_centre"] == ("Neck", "Head")
    assert marker_joints([*names, "L_Collar"])["head_centre"] == ("Head",)
    assert marker_joints(["neck", "head", "headtop"])["head_centre"] == ("neck", "headtop")


@pytest.mark.parametrize("back", [("LPSI", "RPSI"), ("SACR",)])
def test_hips_without_markers_are_found_by_the_pelvis(back):
    """A pelvis 240 mm wide and 150 mm deep, turned and tilted: the regression by hand."""
    left, right, behind = [0.0, 0.12, 0.0], [0.0, -0.12, 0.0], [-0.15, 0.0, 0.0]
    spines = [left, right, *([behind] if len(back) == 1 else [[-0.15, 0.05, 0.0], [-0.15, -0.05, 0.0]])]
    expected = np.array([[-0.0459, 0.0865, -0.0829], [-0.0459, -0.0865, -0.0829]])
    turn = Rotation.from_euler("zyx", [70.0, 10.0, -5.0], degrees=True)
    origin = np.array([1.0, 2.0, 0.9])
    names = (*(f"Anna:{name}" for name in ("LASI", "RASI", *back)), "Anna:LKNE")
    positions = turn.apply(np.array([*spines, [0.0, 0.0, -0.5]]))[None] + origin
    positions = np.repeat(positions, 2, axis=0)
    positions[1, 2] = np.nan
    centres = joint_centres(Markers("a.c3d", names, 50.0, positions), positions)
    hips = centres[:, [JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]]
    np.testing.assert_allclose(hips[0], turn.apply(expected) + origin, atol=1e-9)
    np.testing.assert_allclose(centres[0, JOINT_NAMES.index("pelvis")], hips[0].mean(axis=0))
    assert np.isnan(hips[1]).all()
    named = Markers("a.c3d", (*names[:-1], "Anna:LHJC"), 50.0, positions)
    assert np.isnan(joint_centres(named, positions)[:, JOINT_NAMES.index("right_hip")]).all()


def test_axes_and_unit_can_be_chosen(tmp_path):
    """One person lies along x; the other walks along another axis than the default."""
    truth = walking_joints()
    lying = np.stack([truth[..., 2], truth[..., 1], -truth[..., 0]], axis=-1)  # along the file's x
    path = tmp_path / "a.trc"
    path.write_text(trc_text("a.trc", JOINT_NAMES, lying, 50.0))
    with pytest.raises(InputError, match="the key up or truth_up"):
        read_markers(path)
    np.testing.assert_allclose(joints_in(path, up="y"), lying, atol=1e-6)
    path.write_text(trc_text("a.trc", JOINT_NAMES, truth, 50.0))  # y up, x forward
    np.testing.assert_allclose(joints_in(path, up="y", forward="z"), np.stack(
        [-truth[..., 1], truth[..., 0], truth[..., 2]], axis=-1), atol=1e-6)  # fmt: skip
    np.testing.assert_allclose(joints_in(path, unit="cm"), 10.0 * truth, atol=1e-5)
    for wrong in ({"up": "w"}, {"unit": "ell"}, {"up": "y", "forward": "-y"}):
        with pytest.raises(InputError, match=r"expected two different axes|must be one of"):
            read_markers(path, **wrong)
