"""What the cameras saw: their place in the world, their images, and what is drawn over the images.

Overlays are projected here, not by the viewer: it draws everything of the world before everything flat, so that
the particles would hide the expected pose.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
import rerun as rr

from workbench.arrays import AnyArray, BoolArray, ByteArray, FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.core.frame import Truth
from workbench.errors import InputError
from workbench.recording.write import colours
from workbench.recording.write.columns import Row, Rows

Entities: TypeAlias = Iterator[tuple[str, rr.AsComponents]]

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
    """Tell how to record a camera; raises InputError when the recording uses its name for something else."""
    if camera.name in _TAKEN or not camera.name:
        raise InputError(f"camera: expected a name other than {', '.join(_TAKEN)}, found {camera.name!r}")
    maps = None
    if camera.distortion.any():
        size = (camera.width, camera.height)
        found = cv2.initUndistortRectifyMap(camera.matrix, camera.distortion, None, camera.matrix, size, cv2.CV_16SC2)
        maps = (found[0], found[1])
    path = str(rr.new_entity_path(["world", camera.name]))
    return Picture(path, camera, replace(camera, distortion=np.zeros(5)), maps)


def fixed(shown: Picture) -> Entities:
    """Pose and lens of a camera that stands still, and the looks of what is drawn over its images."""
    camera = shown.camera
    yield shown.path, rr.Transform3D(translation=camera.position, mat3x3=camera.rotation.T)
    size, axes = [camera.width, camera.height], rr.ViewCoordinates.RDF
    lens = rr.Pinhole(image_from_camera=camera.matrix, resolution=size, camera_xyz=axes, image_plane_distance=1.2)
    yield f"{shown.path}/image", lens
    for order, (name, colour, width) in enumerate(_LINES, start=1):
        colors = None if colour is None else [colour]
        radii = rr.Radius.ui_points(width)
        looks = rr.LineStrips2D.from_fields(colors=colors, radii=radii, draw_order=10.0 * order)
        yield f"{shown.path}/image/{name}", looks


def image(shown: Picture, pixels: ByteArray, jpeg_quality: int) -> Rows:
    """One image, (height, width) grey or (height, width, 3) RGB, straightened, as a JPEG."""
    if shown.maps is not None:
        pixels = np.asarray(cv2.remap(pixels, *shown.maps, cv2.INTER_LINEAR), dtype=np.uint8)
    if pixels.ndim == 3:
        pixels = pixels[..., ::-1]  # OpenCV encodes BGR
    _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    yield f"{shown.path}/image", Row(rr.EncodedImage, {"blob": [jpeg.ravel()], "media_type": ["image/jpeg"]})


def overlay(
    shown: Picture, name: str, positions: FloatArray, chains: IntArray, shades: ByteArray | None = None
) -> Rows:
    """Skeletons with joints (n, J, 3), m, drawn as chains (C, longest) of joints; shades: (n, 3) colours.

    Chains that reach behind the camera are left out.
    """
    pixels = shown.camera.project(positions)[:, chains]
    strips = pixels.reshape(-1, *pixels.shape[2:]).astype(np.float32)
    seen = np.isfinite(strips).all(axis=(1, 2))
    colors = {} if shades is None else {"colors": np.repeat(shades, len(chains), axis=0)[seen]}
    yield f"{shown.path}/image/{name}", Row(rr.LineStrips2D, {"strips": strips[seen], **colors})


def truth_marks(shown: Picture, known: Truth | None, names: tuple[str, ...]) -> Entities:
    """The marked joints as points in the straightened image, dark where hidden; no points where there are no marks."""
    marks = np.full((len(names), 2), np.nan) if known is None or known.marks is None else known.marks
    marked: BoolArray = np.all(np.isfinite(marks), axis=1)
    visible = marked if known is None or known.marks_visible is None else known.marks_visible
    points = rr.Points2D(
        straightened(shown.source, marks[marked]),
        colors=np.where(visible[marked, None], colours.TRUTH, colours.TRUTH_HIDDEN).astype(np.uint8),
        radii=rr.Radius.ui_points(2.5),
        labels=[name for name, there in zip(names, marked, strict=True) if there],
        show_labels=False,
        draw_order=40.0,
    )
    yield f"{shown.path}/image/truth_marks", points


def keypoints(shown: Picture, given: FloatArray | None, names: tuple[str, ...]) -> Entities:
    """A view's keypoints (J, 3) as points in the straightened image, the smaller the less they weigh."""
    found = np.full((len(names), 3), np.nan) if given is None else given
    there: BoolArray = np.all(np.isfinite(found), axis=1)
    points = rr.Points2D(
        straightened(shown.source, found[there, :2]),
        colors=[colours.KEYPOINT],
        radii=rr.Radius.ui_points(4.5 * np.sqrt(found[there, 2])),
        labels=[name for name, seen in zip(names, there, strict=True) if seen],
        show_labels=False,
        draw_order=35.0,
    )
    yield f"{shown.path}/image/keypoints", points


def straightened(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Find where pixels (K, 2) of the camera's image lie once it is straightened, (K, 2)."""
    if not camera.distortion.any() or not len(pixels):
        return pixels
    straight = cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, P=camera.matrix)
    return np.asarray(straight, dtype=np.float64)[:, 0]
