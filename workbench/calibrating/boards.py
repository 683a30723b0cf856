"""Checkerboards in images: where their inner corners are."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from workbench.arrays import ByteArray, FloatArray
from workbench.datasets.files.decode import count_frames, decode
from workbench.errors import InputError

MOST_IMAGES = 60
"""Of a video that are searched, evenly spaced; more tell hardly more."""


@dataclass(frozen=True)
class Board:
    """A checkerboard. columns, rows: of inner corners, one less than of squares. square_m: a square's side, m."""

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise InputError(f"board: expected 3×3 inner corners or more, found {self.columns}×{self.rows}")
        if not 0.001 <= self.square_m <= 1.0:
            raise InputError(f"board: expected squares of 0.001 to 1 m, found {self.square_m:g} m")

    @property
    def corners_m(self) -> FloatArray:
        """The inner corners (K, 3) in the board's own frame, m, row by row; x along a row, z = 0."""
        v, u = np.mgrid[: self.rows, : self.columns]
        return np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1) * self.square_m

    @property
    def has_two_ends(self) -> bool:
        """Tell whether it looks another way when it is turned upside down."""
        return (self.columns + self.rows) % 2 == 1


@dataclass(frozen=True, eq=False)
class Sightings:
    """A board in the images of one camera. source: where they are from. size: (width, height), px. n_searched: how many
    images were searched. corners: (K, 2) pixels by the image's number in its source."""

    source: str
    size: tuple[int, int]
    n_searched: int
    corners: dict[int, FloatArray]


def find_boards(source: Path, board: Board, also: int | None = None) -> Sightings:
    """Search a video, or a folder of images, for a board: where there are many, MOST_IMAGES of them, evenly spaced, and
    number `also`.

    Raises InputError for a source that cannot be read, and images of different sizes.
    """
    n = count_frames(source)
    wanted = set(np.unique(np.linspace(0, n - 1, min(n, MOST_IMAGES)).round().astype(int)).tolist()) | {also}
    size, corners = None, {}
    images = tqdm(enumerate(decode(source)), f"searching {source.name}", n, unit="image", disable=None)
    for number, image in images:
        if size not in (None, image.shape[1::-1]):
            found = "×".join(map(str, image.shape[1::-1]))
            raise InputError(f"{source}: image {number} is {found} px, expected {size[0]}×{size[1]} as the first")
        size = image.shape[1], image.shape[0]
        if number in wanted and (seen := find_corners(image, board)) is not None:
            corners[number] = seen
    if size is None:
        raise InputError(f"{source}: expected images, found none that can be decoded")
    return Sightings(str(source), size, len(wanted - {None}), corners)


def find_corners(image: ByteArray, board: Board) -> FloatArray | None:
    """Return the inner corners (K, 2), px, of a board in an RGB image, row by row; None where it is not seen whole.

    The first corner is the one in whose square, between it and its neighbours in the row and the column, it is dark.
    Of a board with two ends this is one corner, whichever way up it is held.
    """
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    pattern = board.columns, board.rows
    seen, corners = cv2.findChessboardCornersSB(grey, pattern, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not seen:
        return None
    found = corners.reshape(board.rows, board.columns, 2).astype(np.float64)
    row, column = found[0, -1] - found[0, 0], found[-1, 0] - found[0, 0]
    if row[0] * column[1] < row[1] * column[0]:  # as in a mirror, in which no board is seen
        found = found[::-1]
    if board.has_two_ends and _shade(grey, found[:2, :2]) > _shade(grey, found[:2, 1:3]):
        found = found[::-1, ::-1]
    return found.reshape(-1, 2)


def _shade(grey: ByteArray, square: FloatArray) -> float:
    """Return the median grey level in the middle of a square with corners (2, 2, 2), px."""
    weights = np.linspace(0.3, 0.7, 5)
    across = square[:, :1] + weights[None, :, None] * (square[:, 1:] - square[:, :1])
    pixels = across[:1] + weights[:, None, None] * (across[1:] - across[:1])
    u, v = pixels.reshape(-1, 2).round().astype(int).T
    return float(np.median(grey[v.clip(0, len(grey) - 1), u.clip(0, grey.shape[1] - 1)]))
