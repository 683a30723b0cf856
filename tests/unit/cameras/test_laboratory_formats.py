"""Camera files of laboratories: a known camera, written by each format's definition, is read back."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from valid_files import write_storage

from workbench.cameras.calibration import fitted, in_units, read_calibration
from workbench.cameras.camera import Camera
from workbench.cameras.camera_file import load_cameras, stated_unit
from workbench.utils.errors import InputError

SIZE = (640, 480)


def camera(name, rotation=(1.2, -0.4, 0.3), position=(0.5, -4.0, 1.5), distortion=(-0.1, 0.02, 0.001, -0.002, 0.003)):
    turn = Rotation.from_rotvec(rotation).as_matrix()
    matrix = np.array([[500.0, 0.0, 322.5], [0.0, 510.0, 238.25], [0.0, 0.0, 1.0]])
    return Camera(name, *SIZE, matrix, turn, -turn @ np.array(position), np.array(distortion))


RIG = (
    camera("a", position=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)),
    camera("b"),
    camera("c", (0.1, 2.2, -1.4), (2.0, 3.0, 1.0)),
)
PLACED = RIG[1:]


def qualisys(path, cameras):
    """Write rotations whose rows are the axes of a camera with y up that looks along -z; lengths in 1/64 px and mm. The
    images are a part of the sensor, from its column 100 and row 50."""
    text = ""
    for each in cameras:
        k1, k2, p1, p2, k3 = each.distortion
        axes = np.array([each.rotation[0], -each.rotation[1], -each.rotation[2]])
        x, y, z = 1000.0 * each.position
        turn = " ".join(f'r{i + 1}{j + 1}="{axes[i, j]!r}"' for i in range(3) for j in range(3)).replace(
            "np.float64", ""
        )
        fx, fy, cx, cy = 64.0 * (each.matrix[[0, 1, 0, 1], [0, 1, 2, 2]] + [0.0, 0.0, 100.0, 50.0])
        text += (
            f'<camera active="1" serial="{each.name}" model="Miqus Video" viewrotation="0">'
            f'<fov_video left="100" top="50" right="{99 + each.width}" bottom="{49 + each.height}"/>'
            f'<transform x="{x}" y="{y}" z="{z}" {turn.replace("(", "").replace(")", "")}/>'
            f'<intrinsic focallength="9.2" focalLengthU="{fx}" focalLengthV="{fy}" centerPointU="{cx}" '
            f'centerPointV="{cy}" skew="0" radialDistortion1="{k1}" radialDistortion2="{k2}" radialDistortion3="{k3}" '
            f'tangentalDistortion1="{p1}" tangentalDistortion2="{p2}"/></camera>'
        )
    markers = '<camera serial="5" model="Miqus M3"><transform x="0"/></camera>'
    path.write_text(
        f"<?xml version='1.0' encoding='ASCII'?><calibration><cameras>{markers}{text}</cameras></calibration>"
    )


def vicon(path, cameras, radial='VICON_RADIAL="0 0"'):
    """Write the quaternion x, y, z, w from the world to the camera, and its position, mm."""
    text = '<Camera DEVICEID="9" TYPE="Vantage" DISPLAY_TYPE="V5"><KeyFrames><KeyFrame/></KeyFrames></Camera>'
    for each in cameras:
        quaternion = " ".join(map(str, Rotation.from_matrix(each.rotation).as_quat()))
        (fx, fy), (cx, cy) = each.matrix[[0, 1], [0, 1]], each.matrix[:2, 2]
        text += (
            f'<Camera DEVICEID="{each.name}" TYPE="VideoInputDevice" PIXEL_ASPECT_RATIO="{fx / fy}" SKEW="0" '
            f'SENSOR_SIZE="{each.width} {each.height}"><KeyFrames><KeyFrame FOCAL_LENGTH="{fx}" FRAME="0" '
            f'ORIENTATION="{quaternion}" POSITION="{" ".join(map(str, 1000.0 * each.position))}" '
            f'PRINCIPAL_POINT="{cx} {cy}" {radial}/></KeyFrames></Camera>'
        )
    path.write_text(f'<?xml version="1.0" encoding="UTF-8" standalone="no" ?><Cameras VERSION="1.0">{text}</Cameras>')


def easymocap(path, cameras, sizes=True):
    """Write intri.yml and extri.yml."""
    lenses, poses = {}, {}
    for each in cameras:
        lenses |= {f"K_{each.name}": each.matrix, f"dist_{each.name}": each.distortion[None]}
        lenses |= {f"H_{each.name}": each.height, f"W_{each.name}": each.width} if sizes else {}
        poses |= {f"R_{each.name}": cv2.Rodrigues(each.rotation)[0], f"Rot_{each.name}": each.rotation}
        poses |= {f"T_{each.name}": each.translation[:, None]}
    names = "names:\n" + "".join(f'   - "{each.name}"\n' for each in cameras)
    for name, values in (("intri.yml", lenses), ("extri.yml", poses)):
        write_storage(path.with_name(name), **values)
        text = path.with_name(name).read_text()
        path.with_name(name).write_text(text.replace("---\n", f"---\n{names}", 1))


def opencv_pair(path, cameras):
    first, second = cameras
    lenses = {"M1": first.matrix, "D1": first.distortion, "M2": second.matrix, "D2": second.distortion}
    turn = second.rotation @ first.rotation.T
    write_storage(path.with_name("intrinsics.yml"), **lenses)
    poses = {"R": turn, "T": second.translation - turn @ first.translation, "R1": np.eye(3), "Q": np.eye(4)}
    write_storage(path.with_name("extrinsics.yml"), **poses)


def toml(path, cameras, table="{}", extra=""):
    text = ""
    for k, each in enumerate(cameras):
        text += (
            f"[{table.format(k)}]\n{extra.format(name=each.name)}size = [ {each.width}, {each.height},]\n"
            f"matrix = {each.matrix.tolist()}\ndistortions = {each.distortion.tolist()}\n"
            f"rotation = {cv2.Rodrigues(each.rotation)[0].ravel().tolist()}\n"
            f"translation = {each.translation.tolist()}\n"
        )
    path.write_text(text + "[metadata]\n")


def anipose(path, cameras):
    toml(path, cameras, "cam_{}", 'name = "{name}"\n')


def freemocap(path, cameras):
    toml(path, cameras, "cam_{}", 'name = "{name}"\nfisheye = false\nworld_position = [0, 0, 0]\n')


def caliscope(path, cameras):
    toml(path, cameras, "cameras.{}", 'port = 0\nname = "{name}"\nerror = 0.1\nexposure = "null"\ngrid_count = 20\n')


def multical(path, cameras, poses=None):
    lenses = {
        each.name: {
            "model": "standard", "image_size": [each.width, each.height], "K": each.matrix.tolist(),
            "dist": [each.distortion.tolist()],
        } for each in cameras
    }  # fmt: skip
    poses = poses or {each.name: (each.rotation, each.translation) for each in cameras}
    relative = {key: {"R": turn.tolist(), "T": shift.tolist()} for key, (turn, shift) in poses.items()}
    path.write_text(json.dumps({"cameras": lenses, "camera_poses": relative, "image_sets": {"rgb": []}}))


def between(one, other):
    """Return rotation and translation from the axes of another camera to those of one."""
    turn = one.rotation @ other.rotation.T
    return turn, one.translation - turn @ other.translation


def multical_relative(path, cameras):
    first, *others = cameras
    poses = {first.name: (np.eye(3), np.zeros(3))}
    multical(path, cameras, poses | {f"{each.name}_to_{first.name}": between(each, first) for each in others})


def multical_chain(path, cameras):
    first, *others = cameras
    poses = {first.name: (first.rotation, first.translation)}
    chain = {f"{b.name}_to_{a.name}": between(b, a) for a, b in zip(cameras, others, strict=False)}
    multical(path, cameras, poses | chain)


def mccalib(path, cameras, group=0):
    """Write poses from the camera to the world; the matrices end with 0."""
    nodes = {"nb_camera": len(cameras)}
    for k, each in enumerate(cameras):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = each.rotation.T, each.position
        matrices = {"camera_matrix": each.matrix * [[1], [1], [0]], "camera_pose_matrix": pose}
        matrices["distortion_vector"] = each.distortion[None]
        nodes[each.name] = {
            key: {"rows": len(value), "cols": value.shape[1], "dt": "d", "data": value.ravel().tolist()}
            for key, value in matrices.items()
        } | {"distortion_type": 0, "camera_group": k * group, "img_width": each.width, "img_height": each.height}
    path.write_text("%YAML:1.0\n---\n" + yaml.safe_dump(nodes))


def kalibr(path, cameras, **keys):
    """Write a chain of cameras from the last to the first, so that their order is that of the names."""
    nodes, before = {}, None
    for k, each in enumerate(cameras):
        nodes[f"cam{k}"] = {
            "camera_model": "pinhole", "intrinsics": each.matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
            "distortion_model": "radtan", "distortion_coeffs": each.distortion[:4].tolist(),
            "resolution": [each.width, each.height], "rostopic": f"/cam{k}/image_raw", **keys,
        }  # fmt: skip
        if before is not None:
            turn, shift = between(each, before)
            pose = np.vstack([np.column_stack([turn, shift]), [0.0, 0.0, 0.0, 1.0]])
            nodes[f"cam{k}"]["T_cn_cnm1"] = pose.tolist()
        before = each
    path.write_text(yaml.safe_dump(dict(reversed(nodes.items())), sort_keys=False))


def panoptic(path, cameras):
    """Write translations in cm, as columns."""
    nodes = [
        {
            "name": each.name, "type": "hd", "resolution": [each.width, each.height], "panel": 0, "node": k,
            "K": each.matrix.tolist(), "distCoef": each.distortion.tolist(), "R": each.rotation.tolist(),
            "t": (100.0 * each.translation)[:, None].tolist(),
        } for k, each in enumerate(cameras)
    ]  # fmt: skip
    path.write_text(json.dumps({"calibDataSource": "160422_calib_norm", "cameras": nodes}))


def humaneva(path, cameras):
    """Write a file for each camera, in mm."""
    for each in cameras:
        lens = [*each.matrix[[0, 1], [0, 1]], *each.matrix[:2, 2], 0.0, *each.distortion]
        numbers = [*lens, *each.rotation.ravel(), *(1000.0 * each.translation)]
        path.with_name(f"{each.name}.cal").write_text("\n".join(map(str, numbers)))


KINDS = {
    "rig.qca.txt": (qualisys, "mm"), "rig.xcp": (vicon, "mm"), "extri.yml": (easymocap, None),
    "anipose.toml": (anipose, None), "freemocap.toml": (freemocap, None), "caliscope.toml": (caliscope, None),
    "multical.json": (multical, None), "mccalib.yml": (mccalib, None), "panoptic.json": (panoptic, "cm"),
    "b.cal": (humaneva, "mm"),
}  # fmt: skip


def check(read, expected):
    """Compare the images of random points in front of the cameras."""
    by_name = {each.name: each for each in read}
    for each in expected:
        one = by_name[each.name]
        one = in_units(one, SIZE)
        assert (one.width, one.height) == SIZE
        depths = np.random.default_rng(0).uniform([-1.0, -0.8, 2.0], [1.0, 0.8, 6.0], (50, 3))
        points = (depths - each.translation) @ each.rotation
        np.testing.assert_allclose(one.project(points), each.project(points), atol=1e-6)
        np.testing.assert_allclose(one.position, each.position, atol=1e-9)


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rotation=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    position=st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    coefficients=st.tuples(st.floats(-0.2, 0.2), *[st.floats(-0.01, 0.01)] * 4),
)
def test_a_camera_is_read_back(tmp_path, name, rotation, position, coefficients):
    write, unit = KINDS[name]
    known = camera("b", rotation, position, (0.0,) * 5 if write is vicon else coefficients)
    write(tmp_path / name, [known])
    assert stated_unit(tmp_path / name) == unit
    check(read_calibration(tmp_path / name, "m" if unit is None else None, None), [known])


@pytest.mark.parametrize("name", [*KINDS, "intri.yml"])
def test_several_cameras_are_read_in_metres(tmp_path, name):
    write = easymocap if name == "intri.yml" else KINDS[name][0]
    expected = [replace(each, distortion=np.zeros(5)) if write is vicon else each for each in PLACED]
    write(tmp_path / name, expected)
    check(read_calibration(tmp_path if write is humaneva else tmp_path / name, None, None), expected)


@pytest.mark.parametrize("write", [multical, multical_relative, multical_chain])
def test_poses_of_multical_are_of_cameras_or_between_these(tmp_path, write):
    write(tmp_path / "c.json", RIG)
    check(load_cameras(tmp_path / "c.json"), RIG)


def test_the_first_camera_of_kalibr_is_the_world(tmp_path):
    radial = [replace(each, distortion=each.distortion * [1, 1, 1, 1, 0]) for each in [*RIG, *RIG]]
    kalibr(tmp_path / "c.yaml", 2 * radial)  # over ten cameras: cam10 is after cam9
    poses = [between(each, radial[0]) for each in 2 * radial]
    expected = [
        replace(each, name=f"cam{k}", rotation=turn, translation=shift)
        for k, (each, (turn, shift)) in enumerate(zip(2 * radial, poses, strict=True))
    ]
    check(load_cameras(tmp_path / "c.yaml"), expected)
    assert stated_unit(tmp_path / "c.yaml") == "m"


def test_cameras_of_kalibr_with_another_lens_or_without_a_pose_are_rejected(tmp_path):
    kalibr(tmp_path / "c.yaml", RIG, camera_model="omni")
    with pytest.raises(InputError, match=r"camera \[cam0\]: .*pinhole.*omni"):
        load_cameras(tmp_path / "c.yaml")
    kalibr(tmp_path / "c.yaml", RIG)
    nodes = yaml.safe_load((tmp_path / "c.yaml").read_text())
    del nodes["cam2"]["T_cn_cnm1"]
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(nodes))
    with pytest.raises(InputError, match=r"camera \[cam2\]: .*T_cn_cnm1"):
        load_cameras(tmp_path / "c.yaml")


@pytest.mark.parametrize("name", ["intrinsics.yml", "extrinsics.yml"])
def test_opencvs_pair_of_files_is_one_calibration(tmp_path, name):
    opencv_pair(tmp_path / name, RIG[:2])
    check(load_cameras(tmp_path / name), [replace(each, name=f"cam{k}") for k, each in enumerate(RIG[:2], 1)])


def test_any_names_of_easymocap_and_sizes_of_the_images(tmp_path, caplog):
    expected = [replace(each, name=name) for each, name in zip(PLACED, ("01", "front_left"), strict=True)]
    easymocap(tmp_path / "extri.yml", expected, sizes=False)
    cameras = read_calibration(tmp_path / "intri.yml", None, None)
    assert [(each.width, each.height) for each in cameras] == [(0, 0)] * 2
    check([fitted(each, SIZE, "walk.mp4") for each in cameras], expected)
    assert "walk.mp4: camera 01 has no image size in its file; that of the images, 640×480, is taken" in caplog.text


def test_the_unit_of_the_format_can_be_overridden(tmp_path):
    panoptic(tmp_path / "p.json", PLACED)
    cameras = read_calibration(tmp_path / "p.json", "mm", None)
    np.testing.assert_allclose(cameras[0].position, PLACED[0].position / 10.0, atol=1e-9)


@pytest.mark.parametrize(
    ("radial", "centre", "terms"),
    [("VICON_RADIAL", (322.5, 238.25), (4e-7, -3e-13, 0.0)), ("VICON_RADIAL2", (320.0, 241.0), (4e-7, -3e-13, 1e-19))],
)
def test_vicons_lens_removes_distortion_by_a_polynomial_of_pixels(tmp_path, radial, centre, terms):
    """The distance from the centre has the scale of x; 4e-7 / px² moves the corners by up to 21 px."""
    words = terms[:2] if radial == "VICON_RADIAL" else ("Vicon3Parameter", *centre, *terms)
    known = RIG[0]
    vicon(tmp_path / "v.xcp", [known], f'{radial}="{" ".join(map(str, words))}"')
    (read,) = read_calibration(tmp_path / "v.xcp", None, None)
    pixels = np.random.default_rng(1).uniform([0.0, 0.0], [639.0, 479.0], (200, 2))
    focal, offsets = known.matrix[[0, 1], [0, 1]], pixels - centre
    squared = offsets[:, 0] ** 2 + (offsets[:, 1] * focal[0] / focal[1]) ** 2
    factors = 1.0 + terms[0] * squared + terms[1] * squared**2 + terms[2] * squared**3
    undistorted = offsets * factors[:, None] + centre
    assert np.abs(undistorted - pixels).max() > 15.0
    rays = np.column_stack([(undistorted - known.matrix[:2, 2]) / focal, np.ones(200)])
    np.testing.assert_allclose(read.pixels(rays, -np.inf), pixels, atol=0.1)


def vicon_with_change(path, change):
    """Write a lens by which the corner farthest from the principal point is moved by the change."""
    offsets = RIG[0].matrix[:2, 2] * [1.0, 500.0 / 510.0]
    offsets = np.maximum(offsets, (np.array(SIZE) - 1.0 - RIG[0].matrix[:2, 2]) * [1.0, 500.0 / 510.0])
    vicon(path, [RIG[0]], f'VICON_RADIAL="{change / (offsets @ offsets)} 0"')


@pytest.mark.parametrize(
    ("change", "message"), [(2.0, "its lens differs by"), (-0.333, "its lens differs by"), (-0.334, "points farther")]
)
def test_a_lens_of_vicon_maps_two_distances_to_two(tmp_path, change, message):
    """With r (1 - r² / 3), in units of the corner's distance, the corner's surroundings are at one distance."""
    vicon_with_change(tmp_path / "v.xcp", change)
    with pytest.raises(InputError, match=message):
        load_cameras(tmp_path / "v.xcp")


def test_a_wide_lens_of_vicon_is_read(tmp_path, caplog):
    """Vicon's own wide cameras move the corners by six tenths."""
    vicon_with_change(tmp_path / "v.xcp", 0.6)
    load_cameras(tmp_path / "v.xcp")
    assert float(caplog.text.split("coefficients to ")[1].split()[0]) < 2.0


WRONG = [
    (
        "rig.qca.txt",
        "focalLengthU",
        "focalLength",
        r"camera \[b\]: expected focalLengthU of <intrinsic> with 1 numbers",
    ),
    ("rig.qca.txt", "fov_video", "fov", r"camera \[b\]: expected an element <fov_video>"),
    ("rig.qca.txt", 'r11="', 'r11="a', "expected numbers for r11, found 'a"),
    ("rig.qca.txt", "<?xml", "[xml", "expected XML with cameras of Qualisys"),
    ("rig.qca.txt", "</cameras>", "", "expected XML: mismatched tag"),
    ("rig.xcp", "ORIENTATION", "TURN", r"camera \[b\]: expected ORIENTATION of <KeyFrame> with 4 numbers, found None"),
    ("rig.xcp", 'FOCAL_LENGTH="', 'FOCAL_LENGTH="-', "expected a positive FOCAL_LENGTH"),
    ("rig.xcp", 'ORIENTATION="', 'ORIENTATION="1', "expected an ORIENTATION of length 1, found"),
    ("rig.xcp", "VICON_RADIAL=", "VICON_RADIAL2=", "expected VICON_RADIAL2 Vicon3Parameter and 5 numbers, found '0 0'"),
    ("rig.xcp", 'VICON_RADIAL="0', 'VICON_RADIAL="0.1', "its lens differs by"),
    ("rig.xcp", 'DEVICEID="c"', 'DEVICEID="b"', "expected different names of the cameras, found 'b' twice"),
    ("rig.xcp", "<Cameras", "<!DOCTYPE a [<!ENTITY b 'c'>]><Cameras", "expected XML without entities"),
    ("extri.yml", "data: [ 5", 'data: [ "a", 5', r"camera \[b\]: 'matrix' must hold 3×3 numbers"),
    ("anipose.toml", "matrix", "mat", "'matrix'"),
    ("freemocap.toml", "distortions = [", "distortions = [0.1, ", "'distortions' must hold 1 or 4 or 5"),
    ("caliscope.toml", "translation", "shift", "'translation'"),
    ("multical.json", '"T": [', '"T": [1.0, ', r"camera_poses \[b\]: expected 3 numbers"),
    ("panoptic.json", '"K": [[500.0, ', '"K": [[', r"camera \[b\]: 'matrix' must hold 3×3 numbers"),
    ("b.cal", "\n0.0\n", "\n0.0 0.0\n", "expected the 22 numbers of a camera of HumanEva, found 23"),
    ("b.cal", "\n0.0\n", "\n0.5\n", "expected pixels without skew, found 0.5"),
    ("b.cal", "\n0.0\n", "\nx\n", "expected numbers for a camera of HumanEva"),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), WRONG)
def test_a_wrong_file_is_named_with_what_was_expected(tmp_path, name, old, new, message):
    write = KINDS[name][0]
    write(tmp_path / name, [replace(each, distortion=np.zeros(5)) if write is vicon else each for each in PLACED])
    path = tmp_path / ("intri.yml" if write is easymocap else name)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=message) as error:
        load_cameras(path)
    assert str(tmp_path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("named", ["intri.yml", "extri.yml"])
def test_a_lens_of_easymocap_without_a_pose_is_ignored(tmp_path, caplog, named):
    easymocap(tmp_path / "extri.yml", PLACED)
    poses = (tmp_path / "extri.yml").read_text()
    easymocap(tmp_path / "extri.yml", [*PLACED, camera("spare")])
    (tmp_path / "extri.yml").write_text(poses)
    assert [each.name for each in load_cameras(tmp_path / named)] == ["b", "c"]
    assert ("without rotation and translation are ignored: spare" in caplog.text) == (named == "intri.yml")


def test_a_camera_of_caliscope_without_a_pose_is_ignored(tmp_path, caplog):
    caliscope(tmp_path / "c.toml", PLACED)
    missing = 'matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\nrotation = "null"\ntranslation = "null"\n'
    (tmp_path / "c.toml").write_text((tmp_path / "c.toml").read_text() + f"[cameras.9]\n{missing}")
    assert [each.name for each in load_cameras(tmp_path / "c.toml")] == ["b", "c"]
    assert "cameras without rotation and translation are ignored: 9" in caplog.text


def test_a_fisheye_lens_of_anipose_projects_as_by_opencv(tmp_path):
    """To the corners of an image 88° wide."""
    known = camera("b", distortion=(-0.08, 0.0, 0.0, 0.0, 0.0))
    known = replace(known, matrix=np.array([[410.0, 0.0, 319.5], [0.0, 410.0, 239.5], [0.0, 0.0, 1.0]]))
    anipose(tmp_path / "a.toml", [known])
    text = (tmp_path / "a.toml").read_text().replace("-0.08, 0.0, 0.0, 0.0, 0.0]", "-0.08, 0.0, 0.0, 0.0]")
    (tmp_path / "a.toml").write_text(text.replace("[metadata]", "fisheye = true\n[metadata]"))
    (read,) = load_cameras(tmp_path / "a.toml")
    rays = np.random.default_rng(0).uniform(-1.4, 1.4, (500, 2))
    rays = np.column_stack([rays, np.ones(500)])
    expected = cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), known.matrix, known.distortion[:4])
    expected = expected[0][:, 0]
    inside = ((expected >= 0.0) & (expected < SIZE)).all(axis=1)
    assert inside.sum() > 100
    np.testing.assert_allclose(read.pixels(rays[inside], 0.0), expected[inside], atol=1.5)


def test_cameras_of_several_groups_of_mccalib_are_rejected(tmp_path):
    mccalib(tmp_path / "c.yml", PLACED, group=1)
    with pytest.raises(InputError, match="expected one camera_group, found 0, 1, which have no common world"):
        load_cameras(tmp_path / "c.yml")


def test_a_pose_of_mccalib_is_a_rotation(tmp_path):
    mccalib(tmp_path / "c.yml", [replace(RIG[1], rotation=2.0 * RIG[1].rotation)])
    with pytest.raises(InputError, match=r"camera \[b\]: expected a pose with a rotation"):
        load_cameras(tmp_path / "c.yml")


def test_a_pose_between_cameras_of_multical_needs_that_of_the_other(tmp_path):
    multical(tmp_path / "c.json", PLACED, {"b_to_z": between(*PLACED), "c": (np.eye(3), np.zeros(3))})
    with pytest.raises(InputError, match="expected the pose of 'z', to which that of 'b' refers"):
        load_cameras(tmp_path / "c.json")


def test_poses_without_lenses_name_the_missing_file(tmp_path):
    easymocap(tmp_path / "extri.yml", PLACED)
    (tmp_path / "intri.yml").unlink()
    with pytest.raises(InputError, match=r"extri\.yml: has no lenses; expected these in intri\.yml"):
        load_cameras(tmp_path / "extri.yml")


@pytest.mark.parametrize("name", ["cameraIntrinsicsExtrinsics.pickle", "c.pkl"])
def test_a_pickle_is_never_read(tmp_path, name):
    (tmp_path / name).write_bytes(b"cos\nsystem\n(S'false'\ntR.")
    with pytest.raises(
        InputError, match=r"is a pickle, which runs code.*convert OpenCap's files to TOML with Pose2Sim"
    ):
        load_cameras(tmp_path / name)


def test_the_rotation_of_qualisys_images_is_reported(tmp_path, caplog):
    qualisys(tmp_path / "c.qca.txt", PLACED)
    text = (tmp_path / "c.qca.txt").read_text()
    (tmp_path / "c.qca.txt").write_text(text.replace('viewrotation="0"', 'viewrotation="90"', 1))
    load_cameras(tmp_path / "c.qca.txt")
    assert "camera [b]: QTM shows its images turned by 90°; expected images as the sensor's" in caplog.text
    assert "camera [c]" not in caplog.text


def test_an_uncalibrated_camera_of_vicon_is_ignored(tmp_path, caplog):
    vicon(tmp_path / "v.xcp", [replace(each, distortion=np.zeros(5)) for each in PLACED])
    text = (tmp_path / "v.xcp").read_text()
    missing = '<Camera DEVICEID="d" TYPE="VideoInputDevice"><KeyFrames/></Camera></Cameras>'
    (tmp_path / "v.xcp").write_text(text.replace("</Cameras>", missing))
    assert [each.name for each in load_cameras(tmp_path / "v.xcp")] == ["b", "c"]
    assert "camera [d] is not calibrated, and is ignored" in caplog.text
