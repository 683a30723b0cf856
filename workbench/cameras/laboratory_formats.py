"""Calibration files of laboratories: Qualisys, Vicon and HumanEva as tables, EasyMocap, MC-Calib, multical, Kalibr and
Panoptic as mappings with OpenCV's keys.

Each reader converts to x_camera = R x_world + t in the unit of the file, which it names where its format fixes it.
"""

import logging
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.cameras.distortion import check_lens_error, fitted_coefficients
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import LARGEST_PX, parse_xml
from workbench.utils.text import natural_order

log = logging.getLogger(__name__)

Tables = dict[str, dict[str, Any]]

HUMANEVA = ".cal"
SUFFIXES = (".qca.txt", ".xcp", HUMANEVA)
_PICKLES = (".pickle", ".pkl")
_SUBPIXELS = 64.0
"""Qualisys' units of the image in a pixel; the coefficients of the lens have no unit."""
_VIDEO = re.compile("video|vue", re.IGNORECASE)
"""Kinds of Qualisys' and Vicon's cameras that record images; the others see markers only."""
_GRID = 41
_ROUNDING = 0.01
"""Largest error of a rotation in a file, whose numbers may be rounded to three places."""


def laboratory_tables(path: Path, text: str) -> Tables | None:
    """Return the cameras of a file of Qualisys, Vicon or HumanEva by name, with the keys of the TOML form; None for any
    other file.

    Parameters
    ----------
    path : of the file; its suffix decides for HumanEva, the elements of the XML for the others.
    text : its content.

    Raises
    ------
    InputError
        For a defect, with the camera.
    """
    suffix = path.suffix.lower()
    if suffix == HUMANEVA:
        return _humaneva(path, text)
    if text.lstrip().startswith("<"):
        root = parse_xml(path, text)
        for camera, read in _XML_READERS.items():
            if elements := root.findall(f".//{camera}"):
                return read(path, elements)
    if suffix in (".txt", ".xcp"):
        raise InputError(f"{path}: expected XML with cameras of Qualisys (.qca.txt) or Vicon (.xcp), found none")
    return None


def refuse_pickle(path: Path) -> None:
    """Raise InputError for the name of a pickle, such as OpenCap's calibrations."""
    if path.suffix.lower() in _PICKLES:
        raise InputError(
            f"{path}: is a pickle, which runs code when it is read; convert OpenCap's files to TOML with Pose2Sim "
            "(calibration_type = 'convert', convert_from = 'opencap')"
        )


def _qualisys(path: Path, elements: list[Element]) -> Tables:
    """Read QTM's exported calibration.

    Lengths in the image are in 1/64 px of the sensor, positions in mm. The rotation's rows are the axes of a camera
    with y up that looks along -z, in the world.
    """
    tables: Tables = {}
    for element in _with_images(elements, "model"):
        place = f"{path}: camera [{element.get('serial')}]"
        lens, view, pose = (_child(place, element, name) for name in ("intrinsic", "fov_video", "transform"))
        left, top, right, bottom = _attributes(place, view, "left", "top", "right", "bottom")
        fx, fy, cx, cy = (
            number / _SUBPIXELS
            for number in _attributes(place, lens, "focalLengthU", "focalLengthV", "centerPointU", "centerPointV")
        )
        k1, k2, k3, p1, p2 = _attributes(
            place, lens, *(f"radialDistortion{k}" for k in (1, 2, 3)), *(f"tangentalDistortion{k}" for k in (1, 2))
        )
        axes = np.array(_attributes(place, pose, *(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))))
        rotation = np.diag([1.0, -1.0, -1.0]) @ axes.reshape(3, 3)
        position = np.array(_attributes(place, pose, "x", "y", "z"))
        if (turned := element.get("viewrotation", "0")) != "0":
            log.warning("%s: QTM shows its images turned by %s°; expected images as the sensor's", place, turned)
        tables[_new_name(path, tables, element.get("serial"))] = {
            "size": [right - left + 1.0, bottom - top + 1.0], "matrix": _matrix(fx, fy, cx - left, cy - top),
            "distortions": [k1, k2, p1, p2, k3], "rotation": rotation.tolist(),
            "translation": (-rotation @ position).tolist(), "unit": "mm",
        }  # fmt: skip
    return tables


def _vicon(path: Path, elements: list[Element]) -> Tables:
    """Read Vicon's calibration (About calibration data (XCP) files, Vicon CaraPost Reference).

    ORIENTATION is the quaternion x, y, z, w of the rotation from the world to the camera, POSITION the camera's, mm.
    The lens removes distortion by a polynomial of the distance, px, from a centre.
    """
    tables: Tables = {}
    for element in _with_images(elements, "TYPE", "DISPLAY_TYPE"):
        name = element.get("DEVICEID")
        place = f"{path}: camera [{name}]"
        if (frame := element.find("KeyFrames/KeyFrame")) is None:
            log.warning("%s is not calibrated, and is ignored", place)
            continue
        size, centre, position = (
            np.array(_numbers(place, node, key, n))
            for node, key, n in ((element, "SENSOR_SIZE", 2), (frame, "PRINCIPAL_POINT", 2), (frame, "POSITION", 3))
        )
        (focal,), (aspect,) = (
            _numbers(place, node, key, 1) for node, key in ((frame, "FOCAL_LENGTH"), (element, "PIXEL_ASPECT_RATIO"))
        )
        quaternion = _numbers(place, frame, "ORIENTATION", 4)
        if not (focal > 0.0 and aspect > 0.0 and (size >= 1.0).all() and (size <= LARGEST_PX).all()):
            raise InputError(f"{place}: expected a positive FOCAL_LENGTH, PIXEL_ASPECT_RATIO and SENSOR_SIZE")
        if not abs(np.linalg.norm(quaternion) - 1.0) < _ROUNDING:
            raise InputError(f"{place}: expected an ORIENTATION of length 1, found {quaternion}")
        rotation = Rotation.from_quat(quaternion).as_matrix()
        matrix, coefficients = _vicon_lens(place, frame, size, np.array(_matrix(focal, focal / aspect, *centre)))
        tables[_new_name(path, tables, name)] = {
            "size": size.tolist(), "matrix": matrix.tolist(), "distortions": coefficients.tolist(),
            "rotation": rotation.tolist(), "translation": (-rotation @ position).tolist(), "unit": "mm",
        }  # fmt: skip
    if not tables:
        raise InputError(f"{path}: expected a calibrated camera with a KeyFrame, found none")
    return tables


def _vicon_lens(place: str, frame: Element, size: FloatArray, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return OpenCV's matrix and coefficients of Vicon's polynomial: two terms about the principal point, or three
    about another centre; offsets from it are scaled by 1 + k1 r² + k2 r⁴ + k3 r⁶ to those without distortion."""
    focal, centre = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    middle, terms = centre, [0.0, 0.0]
    if frame.get("VICON_RADIAL2") is not None:
        words = frame.get("VICON_RADIAL2", "").split()
        if len(words) != 6 or words[0] != "Vicon3Parameter":
            raise InputError(
                f"{place}: expected VICON_RADIAL2 Vicon3Parameter and 5 numbers, found {' '.join(words)!r}"
            )
        numbers = _parsed(place, "VICON_RADIAL2", words[1:])
        middle, terms = np.array(numbers[:2]), numbers[2:]
    elif frame.get("VICON_RADIAL") is not None:
        terms = _numbers(place, frame, "VICON_RADIAL", 2)
    if not any(terms):
        return matrix, np.zeros(5)
    columns, rows = (np.linspace(0.0, end, _GRID) for end in size - 1.0)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    offsets = pixels - middle
    squared = (offsets**2 * [1.0, (focal[0] / focal[1]) ** 2]).sum(axis=1)
    powers = [(2.0 * k, term * squared**k) for k, term in enumerate(terms, 1)]
    factors, growth = 1.0 + sum(each for _, each in powers), 1.0 + sum((n + 1.0) * each for n, each in powers)
    if not growth.min() > 0.0:  # the derivative of the distance without distortion
        raise InputError(f"{place}: expected a lens that moves points farther from its centre farther, found {terms}")
    rays = (offsets * factors[:, None] + middle - centre) / focal
    coefficients, fitted, error_px = fitted_coefficients(rays, pixels, matrix)
    check_lens_error(place, error_px)
    return fitted, coefficients


def _humaneva(path: Path, text: str) -> Tables:
    """Read HumanEva's camera: focal lengths, principal point, skew, k1, k2, p1, p2, k3, rotation, translation, mm."""
    numbers = np.array(_parsed(str(path), "a camera of HumanEva", text.split()))
    if numbers.size != 22:
        raise InputError(f"{path}: expected the 22 numbers of a camera of HumanEva, found {numbers.size}")
    if numbers[4] != 0.0:
        raise InputError(f"{path}: expected pixels without skew, found {numbers[4]:g}")
    return {
        path.stem: {
            "size": None, "matrix": _matrix(*numbers[:4]), "distortions": numbers[5:10].tolist(),
            "rotation": numbers[10:19].reshape(3, 3).tolist(), "translation": numbers[19:].tolist(), "unit": "mm",
        }
    }  # fmt: skip


def with_opencv_keys(path: Path, node: Any) -> Any:
    """Return the cameras of EasyMocap, MC-Calib, multical, Kalibr and Panoptic by name with OpenCV's keys; any other
    content unchanged.

    Raises InputError for cameras of MC-Calib and multical without a common world, and of Kalibr of another model.
    """
    if not isinstance(node, dict):
        return node
    names, cameras, poses = node.get("names"), node.get("cameras"), node.get("camera_poses")
    if isinstance(names, list) and any(f"K_{name}" in node for name in names):
        return {str(name): _of_easymocap(node, str(name)) for name in names}
    rig = {name: each for name, each in node.items() if isinstance(each, dict) and "camera_matrix" in each}
    if any("camera_pose_matrix" in camera for camera in rig.values()):
        return _of_mccalib(path, rig)
    chain = {name: each for name, each in node.items() if isinstance(each, dict) and "camera_model" in each}
    if any("T_cn_cnm1" in camera for camera in chain.values()):
        return _of_kalibr(path, chain)
    if isinstance(cameras, dict) and isinstance(poses, dict):
        return {name: _of_multical(path, name, camera, poses) for name, camera in cameras.items()}
    if isinstance(cameras, list) and "calibDataSource" in node:
        return [{**camera, "unit": "cm"} if isinstance(camera, dict) else camera for camera in cameras]
    return node


def _of_easymocap(node: Mapping[str, Any], name: str) -> dict[str, Any]:
    keys = ("K", "dist", "D", "Rot", "R", "T", "H", "W")
    return {key: node[f"{key}_{name}"] for key in keys if f"{key}_{name}" in node}


def _of_mccalib(path: Path, rig: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Invert the poses, which lead from the camera to that of the group's first camera."""
    if len(groups := sorted({str(camera.get("camera_group")) for camera in rig.values()})) > 1:
        raise InputError(f"{path}: expected one camera_group, found {', '.join(groups)}, which have no common world")
    cameras: dict[str, Any] = {}
    for name, camera in rig.items():
        if "camera_pose_matrix" not in camera:
            cameras[name] = dict(camera)
            continue
        # MC-Calib leaves the last row of its matrices zero
        lens = _array(f"{path}: camera [{name}]", _data(camera.get("camera_matrix")), 9).reshape(3, 3)
        pose = np.linalg.inv(_pose_matrix(f"{path}: camera [{name}]", camera["camera_pose_matrix"]))
        cameras[name] = {
            **camera, "camera_matrix": _matrix(lens[0, 0], lens[1, 1], lens[0, 2], lens[1, 2]),
            "R": pose[:3, :3].tolist(), "T": pose[:3, 3].tolist(), "fisheye": camera.get("distortion_type") == 1,
        }  # fmt: skip
    return cameras


def _of_kalibr(path: Path, chain: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the cameras with poses, from the axes of the first camera; each T_cn_cnm1 leads from those of the camera
    before."""
    cameras: dict[str, Any] = {}
    pose = np.eye(4)
    for name, _ in natural_order(list(chain)):
        place, camera = f"{path}: camera [{name}]", chain[name]
        if camera["camera_model"] != "pinhole":
            raise InputError(f"{place}: expected the camera_model pinhole, found {camera['camera_model']!r}")
        if "T_cn_cnm1" in camera:
            pose = _pose_matrix(place, camera["T_cn_cnm1"]) @ pose
        elif cameras:
            raise InputError(f"{place}: expected T_cn_cnm1, the pose relative to the camera before, found none")
        cameras[name] = {**camera, "R": pose[:3, :3].tolist(), "T": pose[:3, 3].tolist(), "unit": "m"}
    return cameras


def _of_multical(path: Path, name: str, camera: Any, poses: Mapping[str, Any]) -> Any:
    """Return a camera with its pose, if it has one; that of "b_to_a" leads from the axes of the camera a to those of
    b."""
    if not isinstance(camera, dict):
        return camera
    camera = {**camera, "fisheye": camera.get("model") == "fisheye"}
    pose, at = np.eye(4), name
    for _ in poses:
        key = next((key for key in poses if key == at or key.startswith(f"{at}_to_")), None)
        if key is None:
            break
        pose = pose @ _rigid(f"{path}: camera_poses [{key}]", poses[key])
        if key == at:
            return {**camera, "R": pose[:3, :3].tolist(), "T": pose[:3, 3].tolist()}
        at = key.removeprefix(f"{at}_to_")
    if at == name:
        return camera
    raise InputError(f"{path}: camera_poses: expected the pose of {at!r}, to which that of {name!r} refers")


def _rigid(place: str, pose: Any) -> FloatArray:
    """Return the matrix (4, 4) of a mapping with R and T."""
    if not isinstance(pose, dict):
        raise InputError(f"{place}: expected R and T, found {pose!r}")
    rows = np.column_stack([_array(place, pose.get("R"), 9).reshape(3, 3), _array(place, pose.get("T"), 3)])
    return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])


def _pose_matrix(place: str, value: Any) -> FloatArray:
    matrix = _array(place, _data(value), 16).reshape(4, 4)
    if not abs(np.linalg.det(matrix[:3, :3]) - 1.0) < _ROUNDING:
        raise InputError(f"{place}: expected a pose with a rotation, found {matrix[:3, :3].tolist()}")
    return matrix


def _data(value: Any) -> Any:
    """Return the numbers of OpenCV's matrix."""
    return value.get("data") if isinstance(value, dict) else value


def _array(place: str, value: Any, size: int) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.size != size or not np.isfinite(array).all():
        raise InputError(f"{place}: expected {size} numbers, found {value!r}")
    return array


def _with_images(elements: list[Element], *kinds: str) -> list[Element]:
    """Return the cameras that record images, by attributes with their kind; all where no kind says so."""
    videos = [each for each in elements if any(_VIDEO.search(each.get(kind, "")) for kind in kinds)]
    return videos or elements


def _new_name(path: Path, tables: Tables, name: str | None) -> str:
    if not name or name in tables:
        raise InputError(f"{path}: expected different names of the cameras, found {name!r}{' twice' if name else ''}")
    return name


def _matrix(fx: float, fy: float, cx: float, cy: float) -> list[list[float]]:
    return [[float(fx), 0.0, float(cx)], [0.0, float(fy), float(cy)], [0.0, 0.0, 1.0]]


def _child(place: str, element: Element, name: str) -> Element:
    if (child := element.find(name)) is None:
        raise InputError(f"{place}: expected an element <{name}>")
    return child


def _attributes(place: str, element: Element, *names: str) -> list[float]:
    """Return the numbers of attributes, which have one each."""
    return [number for name in names for number in _numbers(place, element, name, 1)]


def _numbers(place: str, element: Element, name: str, n: int) -> list[float]:
    """Return the n numbers of an attribute."""
    numbers = _parsed(place, name, element.get(name, "").split())
    if len(numbers) != n:
        raise InputError(f"{place}: expected {name} of <{element.tag}> with {n} numbers, found {element.get(name)!r}")
    return numbers


def _parsed(place: str, what: str, words: list[str]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = [np.nan]
    if not np.isfinite(numbers).all():
        raise InputError(f"{place}: expected numbers for {what}, found {' '.join(words)[:80]!r}")
    return numbers


_XML_READERS: Mapping[str, Callable[[Path, list[Element]], Tables]] = {
    "camera[transform]": _qualisys, "Camera[KeyFrames]": _vicon,
}  # fmt: skip
"""Readers by the elements of cameras."""
