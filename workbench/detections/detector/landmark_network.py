"""BlazePose's landmark network: the joints of one person in a square region of an image."""

from collections.abc import Callable, Set
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import local

import cv2
import numpy as np

from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError

SIZE_PX = 256
"""Width and height of the network's input."""
N_LANDMARKS = 33
"""Landmarks of the body; two more give the next region, four the hands' orientation."""
_HIP_CENTRE, _CIRCLE = 33, 34
"""Auxiliary landmarks: the middle of the hips, and a point on a circle around the person about it."""
_OUTPUTS = {"landmarks": "Identity", "presence": "Identity_1", "heatmap": "Identity_3", "world": "Identity_4"}
Outputs = Callable[[ByteArray], dict[str, FloatArray]]
"""A network: its outputs, with the names of _OUTPUTS, for an image of SIZE_PX, RGB."""
_REGION_SCALE = 1.25
_KERNEL = 7
_MIN_HEAT = 0.5


@dataclass(frozen=True)
class Region:
    """A square of an image. u, v: its centre, px. side: px. angle: from the image's up to its own, rad, clockwise."""

    u: float
    v: float
    side: float
    angle: float = 0.0

    @property
    def to_image(self) -> FloatArray:
        """The affine map (2, 3) from pixels of the network's input to pixels of the image."""
        linear = self.side / SIZE_PX * rotation(self.angle)
        return np.column_stack([linear, [self.u, self.v] - linear @ [0.5 * SIZE_PX, 0.5 * SIZE_PX]])


@dataclass(frozen=True, eq=False)
class PersonLandmarks:
    """One person's landmarks.

    pixels: (33, 2), px of the image. confidence: (33,), the probability that each is visible. world: (33, 3), m, about
    the middle of the hips, x and y along the image's, z away from the camera. presence: the probability that the region
    shows a person. next_region: the region that the person fills.
    """

    pixels: FloatArray
    confidence: FloatArray
    world: FloatArray
    presence: float
    next_region: Region


class LandmarkNetwork:
    """The network in a model file, run by LiteRT where `ai-edge-litert` is installed, else by OpenCV.

    The landmarks of both agree to 0.01 px; LiteRT takes half the time. Each thread that calls it has a network of its
    own, which takes 45 MB.

    Parameters
    ----------
    path : a TensorFlow Lite file, such as pose_landmark_full.tflite.

    Raises
    ------
    InputError : for a file that is no such model.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._load = path, litert_outputs if find_spec("ai_edge_litert") else opencv_outputs
        self._of_thread = local()
        self._of_thread.outputs = self._load(path)  # raises now

    def __call__(self, image: ByteArray, region: Region) -> PersonLandmarks:
        """Return the landmarks of the person in a region of an image (height, width, 3), RGB."""
        crop = cv2.warpAffine(image, region.to_image, (SIZE_PX, SIZE_PX), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        if not hasattr(self._of_thread, "outputs"):
            self._of_thread.outputs = self._load(self._path)
        arrays = self._of_thread.outputs(np.asarray(crop, np.uint8))
        raw = arrays["landmarks"].reshape(-1, 5)
        pixels = raw[:, :2].copy()
        pixels[:N_LANDMARKS] = refined(pixels[:N_LANDMARKS], arrays["heatmap"][0, :N_LANDMARKS])
        in_image = pixels @ region.to_image[:, :2].T + region.to_image[:, 2]
        world = arrays["world"].reshape(-1, 3)[:N_LANDMARKS].copy()
        world[:, :2] = world[:, :2] @ rotation(region.angle).T
        confidence = _logistic(raw[:N_LANDMARKS, 3:]).min(axis=1)
        around = _region(in_image[_HIP_CENTRE], in_image[_CIRCLE])
        return PersonLandmarks(in_image[:N_LANDMARKS], confidence, world, float(arrays["presence"].item()), around)


def opencv_outputs(path: Path) -> Outputs:
    """Return the network in a file, run by OpenCV; InputError as of `LandmarkNetwork`."""
    engine = (cv2.dnn.ENGINE_CLASSIC,) if hasattr(cv2.dnn, "ENGINE_CLASSIC") else ()  # OpenCV 5's own mixes outputs
    try:
        network = cv2.dnn.readNetFromTFLite(str(path), *engine)
        names = set(network.getUnconnectedOutLayersNames())
    except cv2.error as error:
        raise InputError(f"{path}: expected a BlazePose landmark model, found {error.err or error}") from None
    _check_outputs(path, names)

    def outputs(crop: ByteArray) -> dict[str, FloatArray]:
        network.setInput(cv2.dnn.blobFromImage(crop, 1.0 / 255.0))
        arrays = network.forward(list(_OUTPUTS.values()))
        return {name: np.asarray(array, dtype=np.float64) for name, array in zip(_OUTPUTS, arrays, strict=True)}

    return outputs


def litert_outputs(path: Path) -> Outputs:
    """Return the network in a file, run by LiteRT in one thread; InputError as of `LandmarkNetwork`."""
    interpreter_module = import_module("ai_edge_litert.interpreter")
    try:
        interpreter = interpreter_module.Interpreter(model_path=str(path), num_threads=1)
        interpreter.allocate_tensors()
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: expected a BlazePose landmark model, found {error}") from None
    places = {detail["name"]: detail["index"] for detail in interpreter.get_output_details()}
    _check_outputs(path, set(places))
    (given,) = interpreter.get_input_details()

    def outputs(crop: ByteArray) -> dict[str, FloatArray]:
        interpreter.set_tensor(given["index"], crop[None].astype(np.float32) / np.float32(255.0))
        interpreter.invoke()
        arrays = {
            name: np.asarray(interpreter.get_tensor(places[output]), np.float64) for name, output in _OUTPUTS.items()
        }
        arrays["heatmap"] = np.moveaxis(arrays["heatmap"], -1, 1)  # channels first, as OpenCV's
        return arrays

    return outputs


def _check_outputs(path: Path, names: Set[str]) -> None:
    if not set(_OUTPUTS.values()) <= names:
        raise InputError(f"{path}: expected a BlazePose landmark model, found outputs {', '.join(sorted(names))}")


def rotation(angle: float) -> FloatArray:
    """Return the rotation (2, 2) of the image plane by an angle, rad, clockwise as seen."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])


def refined(pixels: FloatArray, heatmaps: FloatArray) -> FloatArray:
    """Return landmarks (K, 2), px of the network's input, at the mean of their heat maps (K, h, w), logits, over a
    window of 7 × 7 cells about them. A landmark whose window is nowhere likelier than 0.5 stays."""
    height, width = heatmaps.shape[1:]
    cells = pixels * [width, height] / SIZE_PX
    result = pixels.copy()
    for k, (heat, (column, row)) in enumerate(zip(heatmaps, cells, strict=True)):
        left, top = int(column) - _KERNEL // 2, int(row) - _KERNEL // 2
        rows = np.arange(max(top, 0), min(top + _KERNEL, height))
        columns = np.arange(max(left, 0), min(left + _KERNEL, width))
        if not (len(rows) and len(columns)):
            continue
        weights = _logistic(heat[np.ix_(rows, columns)])
        if weights.max() >= _MIN_HEAT:
            mean = np.array([weights.sum(axis=0) @ columns, weights.sum(axis=1) @ rows]) / weights.sum()
            result[k] = mean * SIZE_PX / [width, height]
    return result


def _region(hips: FloatArray, circle: FloatArray) -> Region:
    """Return the region about the hips' middle whose up points to the landmark on the circle around the person."""
    u, v = circle - hips
    side = 2.0 * _REGION_SCALE * max(float(np.hypot(u, v)), 1.0)
    return Region(float(hips[0]), float(hips[1]), side, float(np.arctan2(u, -v)))


def _logistic(logits: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(logits, -60.0, 60.0))))
