"""Calibration of cameras by images of a checkerboard, with OpenCV (Zhang 2000)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from workbench.body.camera import TO_LEVEL, Camera
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.decode import count_frames, decode
from workbench.utils.errors import InputError

_MAX_IMAGES = 60
"""Largest number of searched images of a video, evenly spaced; more improve the result little."""
_MIN_IMAGES, _MIN_COMMON_IMAGES = 5, 3
_OUTLIER_RATIO = 3.0
"""Images whose error exceeds 1 px and this multiple of the median are omitted, as of a bent or blurred one."""
TO_CHECKERBOARD = np.diag([1.0, -1.0, -1.0])
"""From a world with z up to a checkerboard on its floor, whose own z axis points away from the camera."""


@dataclass(frozen=True)
class Checkerboard:
    """A checkerboard. columns, rows: of inner corners, one less than of squares. square_m: side of a square, m."""

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise InputError(f"checkerboard: expected 3×3 inner corners or more, found {self.columns}×{self.rows}")
        if not 0.001 <= self.square_m <= 1.0:
            raise InputError(f"checkerboard: expected squares of 0.001 to 1 m, found {self.square_m:g} m")

    @property
    def corners_m(self) -> FloatArray:
        """The inner corners (K, 3) in the checkerboard's own frame, m, row by row; x along a row, z = 0."""
        v, u = np.mgrid[: self.rows, : self.columns]
        return np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1) * self.square_m

    @property
    def is_asymmetric(self) -> bool:
        """Whether the checkerboard is not symmetric under a half turn."""
        return (self.columns + self.rows) % 2 == 1


@dataclass(frozen=True, eq=False)
class CheckerboardDetections:
    """A checkerboard in the images of one camera. size: (width, height), px. n_searched: number of images searched.
    corners: (K, 2), px, by the image's number in its source."""

    source: str
    size: tuple[int, int]
    n_searched: int
    corners: dict[int, FloatArray]


@dataclass(frozen=True, eq=False)
class Lens:
    """camera: at the origin. sigma_px: standard deviation of the focal length. coverage: fractions of the image's width
    and height that corners span. errors_px, omitted_px: RMS distance of corners by image, used and omitted."""

    camera: Camera
    sigma_px: float
    coverage: tuple[float, float]
    errors_px: Mapping[int, float]
    omitted_px: Mapping[int, float] = field(default_factory=dict)

    @property
    def error_px(self) -> float:
        """RMS distance of all corners used."""
        return float(np.sqrt(np.mean(np.square(list(self.errors_px.values())))))


def find_checkerboards(source: Path, board: Checkerboard, extra_image: int | None = None) -> CheckerboardDetections:
    """Search up to _MAX_IMAGES evenly spaced images of a video or folder, and number `extra_image`, for a checkerboard.

    Raises InputError for a source that cannot be read, and images of different sizes.
    """
    n = count_frames(source)
    searched = set(np.linspace(0, n - 1, min(n, _MAX_IMAGES)).round().astype(int).tolist()) | {extra_image} - {None}
    size, corners = None, {}
    for number, image in tqdm(enumerate(decode(source)), f"searching {source.name}", n, unit="image", disable=None):
        size = size or (image.shape[1], image.shape[0])
        if image.shape[1::-1] != size:
            raise InputError(f"{source}: image {number} has another size than the first, {size[0]}×{size[1]} px")
        if number in searched and (pixels := find_corners(image, board)) is not None:
            corners[number] = pixels
    if size is None:
        raise InputError(f"{source}: expected images, found none that can be decoded")
    return CheckerboardDetections(str(source), size, len(searched), corners)


def find_corners(image: ByteArray, board: Checkerboard) -> FloatArray | None:
    """Return the inner corners (K, 2), px, of a checkerboard in an RGB image, row by row; None unless all are visible.

    The first corner is the one whose square, between it and its neighbours in the row and the column, is dark. For an
    asymmetric checkerboard this corner is the same in every orientation.
    """
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    pattern = board.columns, board.rows
    is_found, pixels = cv2.findChessboardCornersSB(grey, pattern, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not is_found:
        return None
    corners = pixels.reshape(board.rows, board.columns, 2).astype(np.float64)
    row, column = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
    if row[0] * column[1] < row[1] * column[0]:  # mirrored, which is impossible
        corners = corners[::-1]
    if board.is_asymmetric and _grey_level(grey, corners[:2, :2]) > _grey_level(grey, corners[:2, 1:3]):
        corners = corners[::-1, ::-1]
    return corners.reshape(-1, 2)


def _grey_level(grey: ByteArray, square: FloatArray) -> float:
    """Return the median grey level in the middle of a square with corners (2, 2, 2), px."""
    shortest = min(np.linalg.norm(np.diff(square, axis=axis), axis=-1).min() for axis in (0, 1))
    side = max(round(0.3 * float(shortest)), 1)
    return float(np.median(cv2.getRectSubPix(grey, (side, side), square.mean(axis=(0, 1)).tolist())))


def calibrate_lens(name: str, detections: CheckerboardDetections, board: Checkerboard) -> Lens:
    """Return the lens of a camera: focal lengths, principal point and distortion (k1, k2, p1, p2; k3 is 0).

    Raises InputError for fewer than _MIN_IMAGES images of the checkerboard.
    """
    errors = _fit_lens(name, detections, board, list(detections.corners)).errors_px
    limit = max(_OUTLIER_RATIO * float(np.median(list(errors.values()))), 1.0)
    omitted = {number: error for number, error in errors.items() if error > limit}
    lens = _fit_lens(name, detections, board, [number for number in errors if number not in omitted])
    return replace(lens, omitted_px=omitted)


def _fit_lens(name: str, detections: CheckerboardDetections, board: Checkerboard, used: list[int]) -> Lens:
    if len(used) < _MIN_IMAGES:
        raise InputError(
            f"{detections.source}: camera {name}: expected a checkerboard of {board.columns}×{board.rows} inner "
            f"corners in {_MIN_IMAGES} images or more, found it in {len(used)} of {detections.n_searched} searched"
        )
    points = [board.corners_m.astype(np.float32)] * len(used)
    pixels = [detections.corners[number].astype(np.float32) for number in used]
    unknown: Any = None
    result = cv2.calibrateCameraExtended(points, pixels, detections.size, unknown, unknown, flags=cv2.CALIB_FIX_K3)
    _, matrix, distortion, _, _, deviations, _, errors = (np.asarray(each, np.float64) for each in result)
    camera = Camera(name, *detections.size, matrix, np.eye(3), np.zeros(3), distortion.ravel()[:5])
    width, height = np.ptp(np.concatenate(pixels), axis=0) / detections.size
    by_image = dict(zip(used, errors.ravel().tolist(), strict=True))
    return Lens(camera, float(deviations[:2].max()), (float(width), float(height)), by_image)


def pose_cameras(
    cameras: Sequence[Camera], detections: Sequence[CheckerboardDetections], board: Checkerboard
) -> tuple[list[Camera], dict[tuple[str, str], dict[int, float]]]:
    """Return cameras with poses in the frame of the first, from images of the checkerboard in two of them.

    The next camera is always the one with most images in common with a camera already posed. Lenses remain unchanged;
    images correspond by their numbers.

    Returns
    -------
    The cameras, and by pair of a camera and the one it was posed by the RMS distance of corners, px, by image.

    Raises
    ------
    InputError
        For several cameras with a symmetric checkerboard, and for a camera with too few common images.
    """
    if len(cameras) > 1 and not board.is_asymmetric:
        raise InputError(
            "checkerboard: several cameras must distinguish its two ends: expected an odd and an even number of inner "
            f"corners, found {board.columns}×{board.rows}"
        )
    posed, errors_px = {0: cameras[0]}, {}
    while len(posed) < len(cameras):
        pairs = [(k, reference) for k in range(len(cameras)) if k not in posed for reference in posed]
        common = {(k, j): sorted(set(detections[k].corners) & set(detections[j].corners)) for k, j in pairs}
        k, reference = max(pairs, key=lambda pair: len(common[pair]))
        camera, base, images = cameras[k], posed[reference], common[k, reference]
        if len(images) < _MIN_COMMON_IMAGES:
            raise InputError(
                f"camera {camera.name}: expected the checkerboard in {_MIN_COMMON_IMAGES} images where another "
                f"camera detects it, found {len(images)}; check that the videos are synchronized"
            )
        points = [board.corners_m.astype(np.float32)] * len(images)
        first, second = (
            [detections[j].corners[number].astype(np.float32) for number in images] for j in (reference, k)
        )
        result: tuple[Any, ...] = cv2.stereoCalibrateExtended(
            points, first, second, base.matrix, base.distortion, camera.matrix, camera.distortion,
            detections[reference].size, np.eye(3), np.zeros((3, 1)), flags=cv2.CALIB_FIX_INTRINSIC,
        )  # fmt: skip
        turn, shift, errors = (np.asarray(result[index], np.float64) for index in (5, 6, -1))
        translation = turn @ base.translation + shift.ravel()
        posed[k] = replace(camera, rotation=turn @ base.rotation, translation=translation)
        rms = np.sqrt(np.mean(errors**2, axis=1)).tolist()
        errors_px[camera.name, base.name] = dict(zip(images, rms, strict=True))
    return [posed[k] for k in range(len(cameras))], errors_px


def place_on_floor(
    cameras: Sequence[Camera], detections: Sequence[CheckerboardDetections], board: Checkerboard, number: int
) -> list[Camera]:
    """Return cameras in a world with z up whose floor is the checkerboard of image `number`.

    The first corner is the origin, rows are along x. Raises InputError where no camera detects the checkerboard in that
    image.
    """
    for camera, one in zip(cameras, detections, strict=True):
        if number in one.corners:
            _, turn, shift = cv2.solvePnP(board.corners_m, one.corners[number], camera.matrix, camera.distortion)
            rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64) @ TO_CHECKERBOARD
            return _move_world(cameras, camera, rotation, np.asarray(shift, np.float64).ravel())
    raise InputError(f"floor: expected the checkerboard in image {number} of at least one camera, found it in none")


def place_level(cameras: Sequence[Camera]) -> list[Camera]:
    """Return cameras in a world with its origin in the first, which is assumed level: x ahead, z up."""
    return _move_world(cameras, cameras[0], TO_LEVEL, np.zeros(3))


def _move_world(
    cameras: Sequence[Camera], camera: Camera, rotation: FloatArray, translation: FloatArray
) -> list[Camera]:
    """Return cameras in the world in which one of them has a rotation (3, 3) and a translation (3,), m."""
    turn = camera.rotation.T @ rotation
    shift = camera.rotation.T @ (translation - camera.translation)
    return [
        replace(each, rotation=each.rotation @ turn, translation=each.rotation @ shift + each.translation)
        for each in cameras
    ]
