"""What the cameras saw: their place in the world, their images, and what is drawn over the images.

Overlays are projected here, not by the viewer: it draws everything of the world before everything flat, so that
the particles would hide the expected pose.
"""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import rerun as rr

from workbench.body.camera import Camera
from workbench.core.frame import Truth
from workbench.recording.write import colours
from workbench.recording.write.columns import Entities, Row, Rows
from workbench.utils.arrays import AnyArray, BoolArray, ByteArray, FloatArray, IntArray
from workbench.utils.errors import InputError

OVERLAYS = ("particles", "estimate", "truth", "truth_marks", "keypoints")
_TAKEN = ("estimate", "truth", "particles")
# What is drawn over an image, from below upwards: (name, colour, half a line's width in the viewer's points).
_LINES = (("particles", None, 0.4), ("estimate", colours.ESTIMATE, 1.75), ("truth", colours.TRUTH, 1.0))


@dataclass(frozen=True, eq=False)
class Picture:
    """A camera as it is recorded: its images straightened, since Rerun's pinhole has no distortion.

    path: the camera's entity. source: the real camera. camera: the same without distortion. maps: what cv2.remap
    needs to straighten an image, None where there is nothing to do.
    """

    path: str
    source: Camera
    camera: Camera
    maps: tuple[AnyArray, AnyArray] | None


def picture(camera: Camera) -> Picture:
    """Return how to record a camera; raises InputError when the recording uses its name for something else."""
    if camera.name in _TAKEN or not camera.name:
        raise InputError(f"camera: expected a name other than {', '.join(_TAKEN)}, found {camera.name!r}")
    lens, size = (camera.matrix, camera.distortion), (camera.width, camera.height)
    distorted = camera.distortion.any()
    maps = cv2.initUndistortRectifyMap(*lens, None, camera.matrix, size, cv2.CV_16SC2) if distorted else None
    path = str(rr.new_entity_path(["world", camera.name]))
    return Picture(path, camera, replace(camera, distortion=np.zeros(5)), maps)


def taken_by(shown: Picture, camera: Camera) -> Picture:
    """The same picture with the camera that really took it, by which the truth is drawn over it."""
    return replace(shown, camera=replace(camera, distortion=np.zeros(5)))


def fixed(shown: Picture) -> Entities:
    """Yield pose and lens of a camera that stands still, and the styles of what is drawn over its images."""
    camera = shown.camera
    yield shown.path, rr.Transform3D(translation=camera.position, mat3x3=camera.rotation.T)
    size, axes = [camera.width, camera.height], rr.ViewCoordinates.RDF
    lens = rr.Pinhole(image_from_camera=camera.matrix, resolution=size, camera_xyz=axes, image_plane_distance=1.2)
    yield f"{shown.path}/image", lens
    for order, (name, colour, width) in enumerate(_LINES, start=1):
        colors, radii = None if colour is None else [colour], rr.Radius.ui_points(width)
        style = rr.LineStrips2D.from_fields(colors=colors, radii=radii, draw_order=10.0 * order)
        yield f"{shown.path}/image/{name}", style


def image(shown: Picture, pixels: ByteArray, jpeg_quality: int) -> Rows:
    """Yield one image, (height, width) grey or (height, width, 3) RGB, straightened, as a JPEG."""
    if shown.maps is not None:
        pixels = np.asarray(cv2.remap(pixels, *shown.maps, cv2.INTER_LINEAR), dtype=np.uint8)
    if pixels.ndim == 3:
        pixels = pixels[..., ::-1]  # OpenCV encodes BGR
    _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    yield f"{shown.path}/image", Row(rr.EncodedImage, {"blob": [jpeg.ravel()], "media_type": ["image/jpeg"]})


def overlay(
    shown: Picture, name: str, positions: FloatArray, chains: IntArray, shades: ByteArray | None = None
) -> Rows:
    """Yield skeletons with joints (n, J, 3), m, drawn as chains (C, longest) of joints; shades: (n, 3) colours.

    Chains that reach behind the camera are left out.
    """
    pixels = shown.camera.project(positions)[:, chains]
    strips = pixels.reshape(-1, *pixels.shape[2:]).astype(np.float32)
    seen = np.isfinite(strips).all(axis=(1, 2))
    colors = {} if shades is None else {"colors": np.repeat(shades, len(chains), axis=0)[seen]}
    yield f"{shown.path}/image/{name}", Row(rr.LineStrips2D, {"strips": strips[seen], **colors})


def truth_marks(shown: Picture, known: Truth | None, names: tuple[str, ...]) -> Entities:
    """Yield the marked joints as points in the straightened image, dark where hidden; none where there are no marks."""
    marks = np.full((len(names), 2), np.nan) if known is None or known.marks is None else known.marks
    visible = np.ones(len(names), bool) if known is None or known.marks_visible is None else known.marks_visible
    marked: BoolArray = np.all(np.isfinite(marks), axis=1)
    shades = np.where(visible[marked, None], colours.TRUTH, colours.TRUTH_HIDDEN).astype(np.uint8)
    yield _points(shown, "truth_marks", marks, names, 2.5, shades, 40.0)


def keypoints(shown: Picture, given: FloatArray | None, names: tuple[str, ...]) -> Entities:
    """Yield a view's keypoints (J, 3) as points in the straightened image, the smaller the less they weigh."""
    found = np.full((len(names), 3), np.nan) if given is None else given
    radii = 4.5 * np.sqrt(found[np.isfinite(found).all(axis=1), 2])
    yield _points(shown, "keypoints", found, names, radii, [colours.KEYPOINT], 35.0)


def _points(
    shown: Picture, entity: str, places: FloatArray, names: tuple[str, ...], radii: Any, colors: Any, order: float
) -> tuple[str, rr.Points2D]:
    """Named points where all numbers in a row of `places` (J, 2 or more) are known; radii and colors: of these."""
    known: BoolArray = np.all(np.isfinite(places), axis=1)
    labels = [name for name, there in zip(names, known, strict=True) if there]
    points = rr.Points2D(
        straightened(shown.source, places[known, :2]), colors=colors, radii=rr.Radius.ui_points(radii), labels=labels,
        show_labels=False, draw_order=order,
    )  # fmt: skip
    return f"{shown.path}/image/{entity}", points


def straightened(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Find where pixels (K, 2) of the camera's image lie once it is straightened, (K, 2)."""
    if not camera.distortion.any() or not len(pixels):
        return pixels
    straight = cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, P=camera.matrix)
    return np.asarray(straight, dtype=np.float64)[:, 0]
