"""Calibration files of OpenCV (YAML, XML, JSON) and ROS (camera_info), as tables with the keys of the TOML form."""

import logging
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from workbench.body.units import UNITS
from workbench.cameras.laboratory_formats import with_opencv_keys
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import DEEPEST, MAX_CONFIG, parse_json, parse_xml, parse_yaml
from workbench.utils.text import read_text

log = logging.getLogger(__name__)

SUFFIXES = (".yaml", ".yml", ".xml", ".json")
_ROLES = {
    "matrix": "k|m|mtx|matrix|cameramatrix|intrinsics?|intrinsicmatrix",
    "distortions": "d|dist|distcoeffs?|distcoefs?|distortions?|distortion(?:coeffs?|coefficients|vector)",
    "rotation": "r|rot|rvec|rotation|rotationmatrix",
    "translation": "t|tvec|translation|translationvector",
    "pose": "extrinsics?|extrinsicmatrix|rt|worldtocamera|worldtocam|w2c|tcw",
    "size": "size|imagesize|resolution", "width": "w|width|imagewidth|imgwidth",
    "height": "h|height|imageheight|imgheight", "fisheye": "fisheye|fisheyemodel", "model": "distortionmodel",
    "name": "name|cameraname", "unit": "unit",
}  # fmt: skip
"""Keys without letter case and symbols."""
_ROLE = "|".join(f"(?P<{role}>{keys})" for role, keys in _ROLES.items())
_KEY = re.compile(rf"(left|right|cam(?:era)?\d+)?(?:{_ROLE})(left|right|l|r|(?:cam(?:era)?)?\d+)?")
_SIDES = {"l": "left", "r": "right"}
_POLYNOMIAL = ("plumbbob", "radtan", "rationalpolynomial", "rational", "pinhole", "brownconrady", "none", "")
_FISHEYE = ("equidistant", "fisheye", "kannalabrandt")
_INNER = ("intrinsic", "intrinsics", "extrinsic", "extrinsics", "pose")
"""Keys of mappings with a part of a camera's values."""
_PARTS = {"intri": "extri", "Intri": "Extri", "INTRI": "EXTRI"}
"""Parts of the names of two files of the same cameras, with their lenses and with their poses."""


def camera_tables(path: Path, text: str) -> dict[str, dict[str, Any]]:
    """Return the cameras of a file's text as tables with the keys of the TOML form, by name.

    A camera is a mapping with a matrix, as K, camera_matrix or cameraMatrix, or several labelled ones, as
    cameraMatrix1 or mtx_left. The first of two labelled cameras is the world's origin where one R and one T are given:
    x_2 = R x_1 + T. A pose is R and T, or a matrix with both, as RT or extrinsic. A rotation without a translation is
    a rectification, and is ignored. A camera without distortion coefficients has none, and one without an image size
    the size None. Of two files intri.yml and extri.yml, or with such parts in their names, both are read. Raises
    InputError for other text, no camera and an unknown lens model.
    """
    tables: dict[str, dict[str, Any]] = {}
    for name, roles in _cameras(path.stem, with_opencv_keys(path, _of_both(path, _content(path, text)))):
        if name in tables:
            raise InputError(f"{path}: expected different names of the cameras, found {name!r} twice")
        tables[name] = _table(f"{path}: camera [{name}]", roles)
    if not tables:
        raise InputError(f"{path}: expected a camera with a camera_matrix or K, found none")
    return tables


def _of_both(path: Path, content: Any) -> Any:
    """Return the content of a file with that of the other one of a pair."""
    names = {path.name.replace(lens, pose, 1) for lens, pose in _PARTS.items()}
    names |= {path.name.replace(pose, lens, 1) for lens, pose in _PARTS.items()}
    other = next((path.with_name(name) for name in names - {path.name}), None)
    if other is None or not isinstance(content, dict):
        return content
    if not other.exists():
        if any(pose in path.name for pose in _PARTS.values()):
            raise InputError(f"{path}: has no lenses; expected these in {other.name} in the same folder, found none")
        return content
    return _merged(_content(other, read_text(other, MAX_CONFIG)), content)


def _merged(first: Any, second: Any) -> Any:
    """Return two mappings as one, where values of the same key are mappings these as one, else the second's."""
    if not (isinstance(first, dict) and isinstance(second, dict)):
        return second
    return {**first, **{key: _merged(first.get(key), value) for key, value in second.items()}}


def _content(path: Path, text: str) -> Any:
    if path.suffix.lower() == ".json":
        return parse_json(path, text)
    if path.suffix.lower() != ".xml":
        # OpenCV's directive is not YAML's; rostopic ends each message with a line of dashes
        return parse_yaml(path, re.sub(r"\A%YAML.*|!!opencv-[\w-]+|\n---\s*\Z", "", text))
    try:
        return _mapping(parse_xml(path, text))
    except ValueError as error:
        raise InputError(f"{path}: expected XML: {error}") from None


def _mapping(element: ElementTree.Element, depth: int = 0) -> Any:
    """Return the children of an XML element by name, as a list where names repeat, or its words."""
    if depth > DEEPEST:
        raise ValueError(f"found more than {DEEPEST} nested levels")
    children = [(child.tag, _mapping(child, depth + 1)) for child in element]
    if len(dict(children)) < len(children):
        return [inner for _, inner in children]
    return dict(children) or (element.text or "").replace('"', " ").split()


def _cameras(name: str, node: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and values by role of the cameras in a mapping, or else in the mappings and lists inside."""
    node = {str(k): each for k, each in enumerate(node)} if isinstance(node, list) else node
    if not isinstance(node, dict):
        return
    parts = [key for key, value in node.items() if _plain(key) in _INNER and isinstance(value, dict)]
    for part in [key for key in parts if "data" not in node[key]]:
        node = _merged({key: value for key, value in node.items() if key != part}, node[part])
    labelled: dict[str, dict[str, Any]] = {}
    for key, value in node.items():
        if match := _KEY.fullmatch(_plain(key)):
            label = match[1] or match[match.re.groups] or ""
            role = next(role for role in _ROLES if match[role])
            if value is not None or role not in ("rotation", "translation"):
                labelled.setdefault(_SIDES.get(label, label), {})[role] = value
    common = labelled.pop("", {})
    if "matrix" in common:
        yield _word(common.get("name")) or name, common
        return
    pair = {label: each for label, each in sorted(labelled.items()) if "matrix" in each}
    for label, each in pair.items():
        yield f"cam{label}" if label.isdecimal() else label, _pose(common, each, first=label == min(pair), n=len(pair))
    for key, inner in {} if pair else node.items():
        yield from _cameras(str(key), inner)


def _pose(common: Mapping[str, Any], own: Mapping[str, Any], first: bool, n: int) -> dict[str, Any]:
    """Return the values of one of n labelled cameras, with the pose relative to the first of two."""
    if {"rotation", "translation"} <= own.keys():
        return {**common, **own}
    shared = {role: value for role, value in {**common, **own}.items() if role not in ("rotation", "translation")}
    if n != 2 or not {"rotation", "translation"} <= common.keys():
        return shared
    identity = {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.0]}
    return shared | (identity if first else {role: common[role] for role in identity})


def _table(place: str, roles: Mapping[str, Any]) -> dict[str, Any]:
    """Return a camera's table with the keys of the TOML form."""
    table = {role: _numbers(roles[role]) for role in ("matrix", "distortions", "size") if role in roles}
    if {"width", "height"} <= roles.keys():
        table["size"] = _numbers([_word(roles["width"]), _word(roles["height"])])
    table.setdefault("size", None)
    if isinstance(table["matrix"], list) and len(table["matrix"]) == 4:
        fx, fy, cx, cy = table["matrix"]
        table["matrix"] = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    if table.get("distortions", []) == []:
        log.warning("%s has no distortion coefficients; none are assumed", place)
        table["distortions"] = [0.0] * 5
    if {"rotation", "translation"} <= roles.keys():
        table |= {role: _numbers(roles[role]) for role in ("rotation", "translation")}
    elif "pose" in roles:
        rows = _pose_rows(place, roles["pose"])
        table |= {"rotation": rows[:, :3].tolist(), "translation": rows[:, 3].tolist()}
    if (unit := _word(roles.get("unit"))) in UNITS:
        table["unit"] = unit
    model = _plain(_word(roles.get("model")))
    if model not in _POLYNOMIAL + _FISHEYE:
        raise InputError(f"{place}: expected a lens model plumb_bob, rational_polynomial or equidistant, found {model}")
    fisheye = _word(roles.get("fisheye")).lower() not in ("", "0", "false", "no")
    return {**table, "fisheye": fisheye or model in _FISHEYE}


def _pose_rows(place: str, value: Any) -> FloatArray:
    """Return R and T (3, 4) of a matrix with them, (3, 4) or (4, 4), which leads from the world to the camera."""
    try:
        return np.array(_numbers(value), dtype=np.float64).reshape(-1, 4)[:3].reshape(3, 4)
    except ValueError:
        raise InputError(f"{place}: expected R and T as a matrix 3×4 or 4×4, found {value!r}") from None


def _numbers(value: Any) -> Any:
    """Return a matrix of 9 numbers as rows, any other numbers as a list; any other value unchanged."""
    try:
        numbers = np.array(value["data"] if isinstance(value, dict) else value, dtype=np.float64).ravel()
    except (KeyError, TypeError, ValueError, OverflowError):
        return value
    return (numbers.reshape(3, 3) if numbers.size == 9 else numbers).tolist()


def _word(value: Any) -> str:
    """Return a single value as text, "" for none."""
    value = " ".join(map(str, value)) if isinstance(value, list) else value
    return "" if value is None else str(value).strip()


def _plain(text: Any) -> str:
    return "".join(letter for letter in str(text).lower() if letter.isalnum())
