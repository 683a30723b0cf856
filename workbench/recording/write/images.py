"""Cameras, their images, and what is drawn over the images.

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
from workbench.recording.write import styles
from workbench.recording.write.columns import Entities, Row, Rows
from workbench.utils.arrays import AnyArray, ByteArray, FloatArray, IntArray
from workbench.utils.errors import InputError

OVERLAYS = ("particles", "estimate", "truth", "annotations", "keypoints")
_TAKEN_NAMES = ("estimate", "truth", "particles")
# What is drawn over an image, from below upwards: (name, colour, half a line's width in the viewer's points).
_LINES = (("particles", None, 0.4), ("estimate", styles.ESTIMATE, 1.75), ("truth", styles.TRUTH, 1.0))


@dataclass(frozen=True, eq=False)
class RecordedCamera:
    """A camera as it is recorded: its images straightened, since Rerun's pinhole has no distortion.

    path: the camera's entity. source: the real camera. camera: the same without distortion. maps: what cv2.remap
    needs to straighten an image, None where there is nothing to do.
    """

    path: str
    source: Camera
    camera: Camera
    maps: tuple[AnyArray, AnyArray] | None


def picture(camera: Camera) -> RecordedCamera:
    """Return how to record a camera; raises InputError when the recording uses its name for something else."""
    if camera.name in _TAKEN_NAMES or not camera.name:
        raise InputError(f"camera: expected a name other than {', '.join(_TAKEN_NAMES)}, found {camera.name!r}")
    lens, size = (camera.matrix, camera.distortion), (camera.width, camera.height)
    distorted = camera.distortion.any()
    maps = cv2.initUndistortRectifyMap(*lens, None, camera.matrix, size, cv2.CV_16SC2) if distorted else None
    path = str(rr.new_entity_path(["world", camera.name]))
    return RecordedCamera(path, camera, replace(camera, distortion=np.zeros(5)), maps)


def fixed(shown: RecordedCamera) -> Entities:
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


def image(shown: RecordedCamera, pixels: ByteArray, jpeg_quality: int) -> Rows:
    """Yield one image, (height, width) grey or (height, width, 3) RGB, straightened, as a JPEG."""
    if shown.maps is not None:
        pixels = np.asarray(cv2.remap(pixels, *shown.maps, cv2.INTER_LINEAR), dtype=np.uint8)
    if pixels.ndim == 3:
        pixels = pixels[..., ::-1]  # OpenCV encodes BGR
    _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    yield f"{shown.path}/image", Row(rr.EncodedImage, {"blob": [jpeg.ravel()], "media_type": ["image/jpeg"]})


def overlay(
    shown: RecordedCamera, name: str, positions: FloatArray, chains: IntArray, shades: ByteArray | None = None,
    true_camera: Camera | None = None,
) -> Rows:  # fmt: skip
    """Yield skeletons over an image, without chains that reach behind the camera.

    Parameters
    ----------
    name : one of OVERLAYS, or another entity below the image.
    positions : (n, J, 3), m, joints.
    chains : (C, longest) joints.
    shades : (n, 3) colours; None: the style of `fixed`.
    true_camera : projects in place of the recorded one, as the truth needs where the two differ.
    """
    camera = shown.camera if true_camera is None else replace(true_camera, distortion=np.zeros(5))
    pixels = camera.project(positions)[:, chains]
    strips = pixels.reshape(-1, *pixels.shape[2:]).astype(np.float32)
    seen = np.isfinite(strips).all(axis=(1, 2))
    colors = {} if shades is None else {"colors": np.repeat(shades, len(chains), axis=0)[seen]}
    yield f"{shown.path}/image/{name}", Row(rr.LineStrips2D, {"strips": strips[seen], **colors})


def annotations(shown: RecordedCamera, known: Truth | None, names: tuple[str, ...]) -> Entities:
    """Yield the annotated joints as points in the straightened image, dark where hidden; none where there are none."""
    places = np.full((len(names), 2), np.nan) if known is None or known.marks is None else known.marks
    visible = (
        np.ones(len(names), bool) if known is None or known.annotations_visible is None else known.annotations_visible
    )
    shades = np.where(visible[:, None], styles.TRUTH, styles.TRUTH_HIDDEN).astype(np.uint8)
    yield _points(shown, "annotations", places, names, 2.5, shades[_known(places)], 40.0)


def keypoints(shown: RecordedCamera, given: FloatArray | None, names: tuple[str, ...]) -> Entities:
    """Yield a view's keypoints (J, 3) as points in the straightened image, the smaller the less they weigh."""
    places = np.full((len(names), 3), np.nan) if given is None else given
    radii = 4.5 * np.sqrt(places[_known(places), 2])
    yield _points(shown, "keypoints", places, names, radii, [styles.KEYPOINT], 35.0)


def _points(
    shown: RecordedCamera,
    entity: str,
    places: FloatArray,
    names: tuple[str, ...],
    radii: Any,
    colors: Any,
    order: float,
) -> tuple[str, rr.Points2D]:
    """Return named points where `places` (J, 2 or more) are known; radii, colors: of these, or of all."""
    known = _known(places)
    points = rr.Points2D(
        straightened(shown.source, places[known, :2]), colors=colors, radii=rr.Radius.ui_points(radii),
        labels=[names[k] for k in known], show_labels=False, draw_order=order,
    )  # fmt: skip
    return f"{shown.path}/image/{entity}", points


def _known(places: FloatArray) -> IntArray:
    return np.flatnonzero(np.isfinite(places).all(axis=1))


def straightened(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return where pixels (K, 2) of the camera's image lie once it is straightened, (K, 2)."""
    if not camera.distortion.any() or not len(pixels):
        return pixels
    straight = cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, P=camera.matrix)
    return np.asarray(straight, dtype=np.float64)[:, 0]
