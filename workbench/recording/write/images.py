"""Cameras, their images, and overlays on the images.

Overlays are projected here and not by the viewer, which draws all 3-D entities before all 2-D ones, so that particles
would hide the expected pose.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from workbench.cameras.camera import Camera
from workbench.core.frame import Truth
from workbench.recording.write import styles
from workbench.recording.write.columns import Entities, Row, Rows
from workbench.utils.arrays import AnyArray, ByteArray, FloatArray, IntArray
from workbench.utils.errors import InputError

KEYPOINT_RADIUS = 4.5
"""Radius, in the viewer's points, of a keypoint of weight 1."""
OVERLAYS = ("particles", "estimate", "truth", "annotations", "keypoints")
_RESERVED_NAMES = ("estimate", "truth", "particles")
# Overlays from back to front: (name, colour, half a line's width in the viewer's points).
_LINES = (("particles", None, 0.4), ("estimate", styles.ESTIMATE, 1.75), ("truth", styles.TRUTH, 1.0))


@dataclass(frozen=True, eq=False)
class RecordedCamera:
    """A camera with undistorted images, since Rerun's pinhole has no distortion.

    path: entity of the camera. source: the camera. camera: the same without distortion. maps: cv2.remap's maps for
    undistorting an image, None without distortion.
    """

    path: str
    source: Camera
    camera: Camera
    maps: tuple[AnyArray, AnyArray] | None


def recorded_camera(camera: Camera) -> RecordedCamera:
    """Return the recorded camera; raises InputError for a name that the recording reserves."""
    if camera.name in _RESERVED_NAMES or not camera.name:
        raise InputError(f"camera: expected a name other than {', '.join(_RESERVED_NAMES)}, found {camera.name!r}")
    lens, size = (camera.matrix, camera.distortion), (camera.width, camera.height)
    distorted = camera.distortion.any()
    maps = cv2.initUndistortRectifyMap(*lens, None, camera.matrix, size, cv2.CV_16SC2) if distorted else None
    path = str(rr.new_entity_path(["world", camera.name]))
    return RecordedCamera(path, camera, replace(camera, distortion=np.zeros(5)), maps)


def fixed(recorded: RecordedCamera, turns: bool) -> Entities:
    """Yield the styles of overlays on a camera's images, pose and lens; of a camera that turns what is constant."""
    camera = recorded.camera
    if not turns:
        yield recorded.path, rr.Transform3D(translation=camera.position, mat3x3=camera.rotation.T)
    size, axes, matrix = [camera.width, camera.height], rr.ViewCoordinates.RDF, None if turns else camera.matrix
    lens = rr.Pinhole.from_fields(
        image_from_camera=matrix, resolution=[size], camera_xyz=axes, image_plane_distance=1.2
    )
    yield f"{recorded.path}/image", lens
    for order, (name, colour, width) in enumerate(_LINES, start=1):
        colors, radii = None if colour is None else [colour], rr.Radius.ui_points(width)
        style = rr.LineStrips2D.from_fields(colors=colors, radii=radii, draw_order=10.0 * order)
        yield f"{recorded.path}/image/{name}", style


def turned(recorded: RecordedCamera, camera: Camera) -> RecordedCamera:
    """Return the recorded camera of a frame in which it has turned or zoomed."""
    if not np.array_equal(camera.matrix, recorded.source.matrix):
        return recorded_camera(camera)
    return replace(recorded, source=camera, camera=replace(camera, distortion=np.zeros(5)))


def turn(recorded: RecordedCamera) -> Rows:
    """Yield the pose in one frame of a camera that turns."""
    pose = {
        "translation": recorded.camera.position[None],
        "quaternion": Rotation.from_matrix(recorded.camera.rotation.T).as_quat()[None],
    }
    yield recorded.path, Row(rr.Transform3D, pose)


def zoom(recorded: RecordedCamera) -> Entities:
    """Yield the lens from one frame on of a camera that turns."""
    yield f"{recorded.path}/image", rr.Pinhole.from_fields(image_from_camera=recorded.camera.matrix)


def jpeg(recorded: RecordedCamera, pixels: ByteArray, quality: int) -> ByteArray:
    """Return one undistorted image, (height, width) grey or (height, width, 3) RGB, as the bytes (n,) of a JPEG."""
    if recorded.maps is not None:
        pixels = np.asarray(cv2.remap(pixels, *recorded.maps, cv2.INTER_LINEAR), dtype=np.uint8)
    if pixels.ndim == 3:  # OpenCV encodes BGR, and converts faster than NumPy
        pixels = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), dtype=np.uint8)
    _, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(encoded, dtype=np.uint8).ravel()


def video_clip(file: Path) -> tuple[rr.AssetVideo, IntArray]:
    """Return an MP4 file to record, and the timestamps (F,) of its frames, ns; raises InputError for another file."""
    try:
        clip = rr.AssetVideo(path=file)
        return clip, np.asarray(clip.read_frame_timestamps_nanos(), dtype=np.int64)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{file}: expected a video that Rerun reads ({error}); leave recorder.video out") from None


def video_row(recorded: RecordedCamera, timestamps_ns: IntArray, index: int) -> Rows:
    """Yield the row of an image's entity, frame `index` of the video at `video_path` with these timestamps (F,)."""
    if index >= len(timestamps_ns):
        raise InputError(
            f"recorder.video: expected frame {index} in the video, found {len(timestamps_ns)} frames that Rerun reads; "
            "leave recorder.video out"
        )
    timestamp, reference = timestamps_ns[[index]], [video_path(recorded)]
    yield f"{recorded.path}/image", Row(rr.VideoFrameReference, {"timestamp": timestamp, "video_reference": reference})


def video_path(recorded: RecordedCamera) -> str:
    """Return the entity of a camera's video."""
    return f"{recorded.path}/video"


def overlay(
    recorded: RecordedCamera, name: str, positions: FloatArray, chains: IntArray, shades: ByteArray | None = None,
    true_camera: Camera | None = None,
) -> Rows:  # fmt: skip
    """Yield skeletons over an image, without chains that extend behind the camera.

    Parameters
    ----------
    name : one of OVERLAYS, or another entity below the image.
    positions : (n, J, 3), m, joints.
    chains : (C, longest) joints.
    shades : (n, 3) colours; None: the style of `fixed`.
    true_camera : projects instead of the recorded camera, for the truth where the two differ.
    """
    camera = recorded.camera if true_camera is None else replace(true_camera, distortion=np.zeros(5))
    pixels = camera.project(positions)[:, chains]
    strips = pixels.reshape(-1, *pixels.shape[2:]).astype(np.float32)
    visible = np.isfinite(strips).all(axis=(1, 2))
    colors = {} if shades is None else {"colors": np.repeat(shades, len(chains), axis=0)[visible]}
    yield f"{recorded.path}/image/{name}", Row(rr.LineStrips2D, {"strips": strips[visible], **colors})


def annotations(recorded: RecordedCamera, truth: Truth | None, names: tuple[str, ...]) -> Entities:
    """Yield the annotated joints as points in the undistorted image, dark where occluded."""
    pixels = np.full((len(names), 2), np.nan) if truth is None or truth.annotations is None else truth.annotations
    visible = (
        np.ones(len(names), bool) if truth is None or truth.annotations_visible is None else truth.annotations_visible
    )
    shades = np.where(visible[:, None], styles.TRUTH, styles.TRUTH_HIDDEN).astype(np.uint8)
    valid = _valid(pixels)
    points = rr.Points2D(
        undistorted(recorded.source, pixels[valid]), colors=shades[valid], radii=rr.Radius.ui_points(2.5),
        labels=[names[k] for k in valid], show_labels=False, draw_order=40.0,
    )  # fmt: skip
    yield f"{recorded.path}/image/annotations", points


def keypoint_style(recorded: RecordedCamera) -> Entities:
    """Yield the style of a view's keypoints, to be logged static."""
    style = rr.Points2D.from_fields(colors=[styles.KEYPOINT], show_labels=False, draw_order=35.0)
    yield f"{recorded.path}/image/keypoints", style


def keypoints(recorded: RecordedCamera, view_keypoints: FloatArray | None, names: tuple[str, ...]) -> Rows:
    """Yield a view's keypoints (J, 3) as points in the undistorted image, with areas proportional to their weights."""
    rows = np.full((len(names), 3), np.nan) if view_keypoints is None else view_keypoints
    valid = _valid(rows)
    positions = undistorted(recorded.source, rows[valid, :2]).astype(np.float32)
    radii = -KEYPOINT_RADIUS * np.sqrt(rows[valid, 2])  # negative: points of the viewer
    points = {"positions": positions, "radii": radii, "labels": [names[k] for k in valid]}
    yield f"{recorded.path}/image/keypoints", Row(rr.Points2D, points)


def _valid(rows: FloatArray) -> IntArray:
    """Return the rows (J, ...) without NaN."""
    return np.flatnonzero(np.isfinite(rows).all(axis=1))


def undistorted(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return pixels (K, 2) of the camera's image in the undistorted image, (K, 2)."""
    if not camera.distortion.any() or not len(pixels):
        return pixels
    return camera.undistorted(pixels) * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
