"""The motion of a camera, from the background of its video.

A camera that turns about its centre with a constant focal length maps the background by the
homography K R_t K⁻¹, whatever the distances (Hartley & Zisserman, *Multiple View Geometry*, 2004, section 8.4); one
that zooms, by K_t R_t K⁻¹. The rotations are fitted to the tracks by robust least squares. Where no rotation explains
most of the background, the camera travels.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import scipy
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation, Slerp

from workbench.cameras.background_tracks import BRIEF_FRAMES, LONG_SIDE_PX, PARALLAX, STATIC_SHIFT, CornerTracks, stands
from workbench.cameras.camera import Camera
from workbench.cameras.person_height import FOCAL_MEDIAN, FOCAL_SPREAD
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

STATIC, TURNING, TRAVELLING, UNKNOWN = "static", "turning", "travelling", "unknown"
"""Kinds of motion; unknown where the background has too little texture, or moves by itself."""
MAX_UNEXPLAINED = 0.3
"""Fraction of the tracks that do not follow the rotation of a camera that turns: objects in motion, other people."""
_MIN_EPIPOLAR = 0.7
"""Fraction of tracks that follow one epipolar geometry while the camera travels, of those that no turn explains; people
in motion follow none."""
MAX_LOST = 0.1
"""Fraction of frames without a measured background from which on the motion is unknown."""
_FOCAL_FLOOR = 0.1
"""Smallest standard deviation of a focal length's logarithm by turns: with a distortion k₁ the perspective of turns is
that of a focal length (1 + 3 k₁)^-½ times as long, and |k₁| of usual lenses is up to 0.06."""
_MIN_ZOOM = 1.05
"""Ratio of focal lengths of a zoom: half of the smallest step of a zoom lens, and more than what focusing changes."""
_OFF_CENTRE = 0.35
"""Largest distance of a principal point from the middle over the focal length. By a turn about it, an image appears to
zoom by the angle times this ratio, and back with the turn back: a quarter of the longer side, and a wide lens."""
_WIDEST_DEG = 60.0
"""Angle from the axis of a plane image beyond which it is stretched more than four times."""
_EPIPOLAR_PX, _FARTHEST = 0.5, 1e9
"""Distance from epipolar lines in an image of LONG_SIDE_PX, several times the error of a corner; and the distance over
the camera's way within which points are before the camera, any."""
_STEPS = 6
_REPORTED_DEG = 0.5


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Motion of a camera relative to the first of T frames.

    kind: STATIC, TURNING, TRAVELLING or UNKNOWN. rotations: (T, 3, 3), from the first camera's axes to each frame's.
    zooms: (T,) focal lengths over the first frame's. focal, focal_spread: focal length of the first frame over the
    image's longer side, and the standard deviation of its logarithm. moved_px: the largest motion of the background
    since a key frame, px. lost: fraction of frames without a measured background. size: of the images, px. rays: tracks
    from which the turns are fitted, with a focal length for each frame if zooming.
    """

    kind: str
    rotations: FloatArray
    zooms: FloatArray
    focal: float
    focal_spread: float
    moved_px: float
    lost: float
    size: tuple[int, int]
    rays: "_Rays | None" = None
    zooming: bool = False

    @property
    def focal_px(self) -> float:
        """Return the focal length of the first frame, px."""
        return self.focal * max(self.size)

    def at_focal(self, focal: float) -> "CameraMotion":
        """Return the motion for another focal length of the first frame, over the image's longer side."""
        if self.rays is None:
            return self
        rotations, zooms = self.rays.fit(focal, self.zooming)
        return replace(self, rotations=rotations, zooms=zooms, focal=focal)

    def camera(self, known: Camera, known_frame: int, frame: int) -> Camera:
        """Return the camera of a frame from that of another frame; the same object unless the camera turns."""
        if self.kind != TURNING or frame == known_frame:
            return known
        turn = self.rotations[frame] @ self.rotations[known_frame].T
        return known.turned(turn, float(self.zooms[frame] / self.zooms[known_frame]))

    @property
    def middle(self) -> int:
        """Return the frame in which the camera looks nearest to the middle of its directions."""
        axes = self.rotations[:, 2]
        return int(np.argmax(axes @ (axes.min(axis=0) + axes.max(axis=0))))

    def in_middle(self, frames: IntArray, pixels: FloatArray, lens: Camera | None) -> tuple[FloatArray, Camera]:
        """Return where the camera of the middle frame would see what is at pixels (M, J, 2) in some frames (M,), NaN
        beyond _WIDEST_DEG from its axis, and that camera, without distortion.

        lens: of the first frame's images if it is known.
        """
        middle, zero = (np.array(self.size) - 1.0) / 2.0, np.zeros(5)
        matrix = np.array([[self.focal_px, 0.0, middle[0]], [0.0, self.focal_px, middle[1]], [0.0, 0.0, 1.0]])
        first = Camera("camera", *self.size, matrix, np.eye(3), np.zeros(3), zero) if lens is None else lens
        camera = replace(self.camera(first, 0, self.middle), distortion=zero)
        cameras = [self.camera(first, 0, int(frame)) for frame in frames]
        moved = np.stack([in_camera(each, seen_by, camera) for each, seen_by in zip(pixels, cameras, strict=True)])
        tangents = np.linalg.norm((moved - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]], axis=-1)
        return np.where((tangents < np.tan(np.radians(_WIDEST_DEG)))[..., None], moved, np.nan), camera

    def in_first(self, middle: Camera, lens: Camera | None) -> Camera:
        """Return the first frame's camera from that of the middle frame, as of `in_middle`."""
        focal_px = float(middle.matrix[0, 0]) / float(self.zooms[self.middle])
        first = self.at_focal(focal_px / max(self.size)).camera(middle, self.middle, 0)
        return first if lens is None else replace(first, distortion=lens.distortion)

    @property
    def sentence(self) -> str:
        """What the camera does; a clause."""
        if self.kind == STATIC:
            return f"static (the background moved by {self.moved_px:.1f} px)"
        if self.kind == TRAVELLING:
            return "travels: positions are relative to the camera, and not to the ground"
        if self.kind == UNKNOWN:
            followed = f"too little background to tell (followed in {1.0 - self.lost:.0%} of the frames)"
            return f"{followed if self.lost > MAX_LOST else 'much of the background moves by itself'}; taken as static"
        axes, zoom = self.rotations[:, 2], float(self.zooms.max() / self.zooms.min())
        pan = float(np.ptp(np.degrees(np.unwrap(np.arctan2(axes[:, 0], axes[:, 2])))))
        tilt = float(np.ptp(np.degrees(np.arcsin(np.clip(axes[:, 1], -1.0, 1.0)))))
        done = [f"{verb} by {angle:.1f}°" for verb, angle in (("pans", pan), ("tilts", tilt)) if angle > _REPORTED_DEG]
        done += [f"zooms by a factor of {zoom:.2f}"] if zoom > 1.0 else []
        return f"{' and '.join(done or ['shakes'])}, which is compensated"


def in_camera(pixels: FloatArray, seen_by: Camera, camera: Camera) -> FloatArray:
    """Return where `camera` sees what another one at the same place sees at pixels (..., 2); NaN behind it."""
    if camera.is_equal(seen_by):
        return pixels
    flat = seen_by.undistorted(pixels)
    rays = np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)
    return camera.pixels(rays @ seen_by.rotation @ camera.rotation.T, 1e-6)


def camera_motion(tracks: CornerTracks, lens: Camera | None = None) -> CameraMotion:
    """Return the motion of a camera from tracks of its background.

    Parameters
    ----------
    tracks : of its background.
    lens : camera of the images whose matrix and distortion are known; None: the focal length is estimated from the
        perspective of the turns, as far as they are wide.
    """
    n, longer = len(tracks.keys), max(tracks.size)
    shifts = tracks.shifts
    with_tracks = np.isfinite(shifts).any(axis=1)
    moved = _without_brief(np.nanmedian(shifts[with_tracks], axis=1)) if with_tracks.any() else np.zeros(1)
    focal, spread = (FOCAL_MEDIAN, FOCAL_SPREAD) if lens is None else (float(lens.matrix[0, 0]) / longer, 0.0)
    moved_px = longer * float(moved.max())
    still = CameraMotion(
        STATIC, np.tile(np.eye(3), (n, 1, 1)), np.ones(n), focal, spread, moved_px, tracks.lost, tracks.size
    )
    moves = with_tracks & ~stands(shifts, tracks.consistent)
    if tracks.lost > MAX_LOST or not with_tracks.any():
        return replace(still, kind=UNKNOWN)
    if not _without_brief(moves).any():
        return still
    rays = _Rays.of(tracks, lens)
    for fitted, first_focal, focal_spread, zooming in rays.models(focal, spread):
        if fitted.unexplained(first_focal, zooming) <= MAX_UNEXPLAINED:
            turning = replace(still, kind=TURNING, focal_spread=focal_spread, rays=fitted, zooming=zooming)
            return turning.at_focal(first_focal)
    return replace(still, kind=TRAVELLING if rays.epipolar(focal) >= _MIN_EPIPOLAR else UNKNOWN)


def _without_brief(values: FloatArray | BoolArray) -> FloatArray | BoolArray:
    """Return the values (T,) without those that last for less than half of BRIEF_FRAMES."""
    return median_filter(values, size=min(BRIEF_FRAMES, max(len(values), 1)), mode="nearest")


@dataclass(frozen=True, eq=False)
class _Rays:
    """Tracks in a frame without distortion, from the principal point, over the image's longer side: start, end (T, N,
    2), valid, consistent (T, N). keys: (T,) as in `CornerTracks`. far: (m,) from each key frame the frame that is
    farthest from it."""

    keys: IntArray
    start: FloatArray
    end: FloatArray
    valid: BoolArray
    consistent: BoolArray
    far: IntArray

    @staticmethod
    def of(tracks: CornerTracks, lens: Camera | None) -> "_Rays":
        """Return the tracks of a camera whose lens is known, or of one without distortion with its principal point in
        the image's middle."""
        size, longer = np.array(tracks.size), max(tracks.size)
        if lens is None:
            places = [(each - (size - 1.0) / 2.0) / longer for each in (tracks.start, tracks.end)]
        else:
            places = [lens.undistorted(each) * lens.matrix[0, 0] / longer for each in (tracks.start, tracks.end)]
        valid = np.asarray(np.isfinite(places[0] + places[1]).all(axis=2))
        start, end = (np.where(valid[..., None], each, 0.0) for each in places)
        distances = np.linalg.norm(end - start, axis=2).sum(axis=1) / np.maximum(valid.sum(axis=1), 1)
        measured = [
            np.flatnonzero((tracks.keys == key) & valid.any(axis=1)) for key in np.unique(tracks.keys) if key >= 0
        ]
        far = [rows[np.argmax(distances[rows])] for rows in measured if len(rows)]
        return _Rays(tracks.keys, start, end, valid, tracks.consistent & valid, np.array(far, dtype=np.int64))

    def fit(self, focal: float, zooming: bool) -> tuple[FloatArray, FloatArray]:
        """Return rotations (T, 3, 3) and zooms (T,) relative to the first frame; between measured frames they are
        interpolated."""
        n = len(self.keys)
        rotations, zooms = np.tile(np.eye(3), (n, 1, 1)), np.ones(n)
        for key in np.unique(self.keys[self.keys >= 0]):
            rows = np.flatnonzero((self.keys == key) & (np.arange(n) > key) & self.valid.any(axis=1))
            turns, ratios = self._turns(rows, focal * float(zooms[key]), zooming)
            rotations[rows], zooms[rows] = turns @ rotations[key], ratios * zooms[key]
        frames = np.arange(n)
        measured = np.flatnonzero(self.valid.any(axis=1) | (frames == 0) | np.isin(frames, self.keys))
        if 1 < len(measured) < n:
            inside = frames.clip(measured[0], measured[-1])
            rotations = Slerp(measured, Rotation.from_matrix(rotations[measured]))(inside).as_matrix()
            zooms = np.interp(frames, measured, zooms[measured])
        return rotations, zooms

    def models(self, focal: float, spread: float) -> Iterator[tuple["_Rays", float, float, bool]]:
        """Yield the models of a turning camera, the most plausible first, for a known focal length of the first frame,
        with a spread of 0, or an unknown one: a constant focal length, a cropped image, a zoom.

        A model has the tracks from the principal point, the first focal length over the image's longer side, the
        standard deviation of its logarithm, and whether the camera zooms.
        """
        is_known = spread == 0.0
        constant, constant_spread = (focal, spread) if is_known else self.estimated_focal(zooming=False)
        if not self.zooms(constant):
            yield self, constant, constant_spread, False
            if not is_known:
                yield *self.off_centre(constant), FOCAL_SPREAD, False
        free, free_spread = (focal, spread) if is_known else self.estimated_focal(zooming=True)
        yield self, free, free_spread, True

    def off_centre(self, focal: float) -> tuple["_Rays", float]:
        """Return the tracks from another principal point, of an image that is cropped, and the focal length."""

        def moved(x: FloatArray) -> _Rays:
            offset = np.clip(x[1:], -_OFF_CENTRE, _OFF_CENTRE)
            return replace(self, start=self.start - offset, end=self.end - offset)

        def cost(x: FloatArray) -> float:
            errors = moved(x)._far_errors(float(np.exp(x[0])), False)[self.valid[self.far]]
            prior = ((x[0] - np.log(FOCAL_MEDIAN)) / FOCAL_SPREAD) ** 2
            return _robust_cost(errors, STATIC_SHIFT) + 0.5 * float(prior)

        x = scipy.optimize.minimize(cost, [np.log(focal), 0.0, 0.0], method="Nelder-Mead", options={"maxfev": 120}).x
        return moved(x), float(np.exp(x[0]))

    def estimated_focal(self, zooming: bool) -> tuple[float, float]:
        """Return the mean focal length, and the standard deviation of its logarithm, of the posterior by the tracks and
        the prior of `person_height`."""
        logs = np.log(FOCAL_MEDIAN) + np.linspace(-3.0, 3.0, 31) * FOCAL_SPREAD
        errors = [self._far_errors(float(focal), zooming) for focal in np.exp(logs)]
        sigma = _robust_std(np.min([each[self.valid[self.far]] for each in errors], axis=0))
        costs = np.array([_robust_cost(each[self.valid[self.far]], sigma) for each in errors])
        costs += 0.5 * ((logs - np.log(FOCAL_MEDIAN)) / FOCAL_SPREAD) ** 2
        weights = np.exp(costs.min() - costs)
        mean = float(weights @ logs / weights.sum())
        std = float(np.sqrt(weights @ (logs - mean) ** 2 / weights.sum()))
        return float(np.exp(mean)), max(std, _FOCAL_FLOOR)

    def zooms(self, focal: float) -> bool:
        """Return whether the tracks demand a focal length for each frame: by the Bayesian information criterion, and
        by more than _MIN_ZOOM beyond what appears to be a zoom in a pan: by an off-centre principal point of a cropped
        image, and by lens distortion or distances of PARALLAX of the motion over the spread of the tracks."""
        valid = self.valid[self.far]
        constant, free = (self._far_errors(focal, zooming)[valid] for zooming in (False, True))
        sigma = _robust_std(free)
        gain = _robust_cost(constant, sigma) - _robust_cost(free, sigma)
        if gain < 0.5 * len(self.far) * np.log(2.0 * valid.sum()):
            return False
        rotations, ratios = self._turns(self.far, focal, zooming=True)
        turns, logs = Rotation.from_matrix(rotations).as_rotvec()[:, :2], np.log(ratios)
        slope = np.linalg.lstsq(turns, logs, rcond=None)[0]
        slope *= min(1.0, _OFF_CENTRE / max(float(np.linalg.norm(slope)), 1e-12))
        tracks = [(self.start[row, self.valid[row]], self.end[row, self.valid[row]]) for row in self.far]
        shifts = np.array([np.linalg.norm(end - start, axis=1).mean() for start, end in tracks])
        spreads = np.array([np.sqrt(start.var(axis=0).sum()) for start, _ in tracks])
        apparent = PARALLAX * float((shifts / spreads).sum())
        return float(np.ptp(np.cumsum([0.0, *(logs - turns @ slope)]))) > np.log(_MIN_ZOOM) + apparent

    def unexplained(self, focal: float, zooming: bool) -> float:
        """Return the fraction of tracks that the turns do not explain, in the frames that are far from their key
        frames; without what stands still in the image while the rest moves, such as logos and subtitles."""
        misses, counted = self._misses(focal, zooming)
        return float(misses[counted].mean()) if counted.any() else 1.0

    def _misses(self, focal: float, zooming: bool) -> tuple[BoolArray, BoolArray]:
        """Return which tracks (m, N) of the far frames the turns do not explain, and which count, see `unexplained`."""
        errors, shifts = self._far_errors(focal, zooming), np.linalg.norm(self.end - self.start, axis=2)[self.far]
        misses = np.asarray(errors > STATIC_SHIFT + PARALLAX * shifts)
        overlaid = misses & (shifts < 0.5 * STATIC_SHIFT)
        return misses, self.valid[self.far] & ~overlaid

    def epipolar(self, focal: float) -> float:
        """Return the fraction of the tracks without explanation by turns that follow one epipolar geometry before a
        camera of a focal length over the image's longer side, the median of the far frames.

        People who walk to and fro follow one geometry, too, but half of them would then be behind the camera.
        """
        shares, matrix = [], np.diag([LONG_SIDE_PX * focal, LONG_SIDE_PX * focal, 1.0])
        misses, counted = self._misses(focal, False)
        for row, missing, valid in zip(self.far, misses & counted, self.valid[self.far], strict=True):
            start, end = (LONG_SIDE_PX * each[row, valid] for each in (self.start, self.end))
            tolerance_px = max(_EPIPOLAR_PX, PARALLAX * float(np.median(np.linalg.norm(end - start, axis=1))))
            essential, inliers = cv2.findEssentialMat(start, end, matrix, cv2.RANSAC, 0.99, tolerance_px)
            if essential is None or not missing.any():
                shares.append(0.0)
                continue
            before = cv2.recoverPose(essential[:3], start, end, matrix, distanceThresh=_FARTHEST, mask=inliers)[3]
            shares.append(float((before[missing[valid], 0] > 0).mean()))
        return float(np.median(shares))

    def _far_errors(self, focal: float, zooming: bool) -> FloatArray:
        """Return the distances (m, N) of tracks in the far frames from turns that begin with one focal length."""
        turns, ratios = self._turns(self.far, focal, zooming)
        errors, _ = _errors(_rays(self.start[self.far], focal), self.end[self.far], turns, ratios * focal)
        return np.asarray(np.linalg.norm(errors, axis=2))

    def _turns(self, rows: IntArray, focal: float, zooming: bool) -> tuple[FloatArray, FloatArray]:
        """Return rotations (m, 3, 3) and ratios (m,) of focal lengths that map the tracks of frames from their key
        frames, by Gauss–Newton steps: first of the homography's inliers, then of all with Geman–McClure weights."""
        rays, end = _rays(self.start[rows], focal), self.end[rows]
        rotations, ratios, free = np.tile(np.eye(3), (len(rows), 1, 1)), np.ones(len(rows)), 4 if zooming else 3
        for step in range(_STEPS):
            errors, jacobian = _errors(rays, end, rotations, ratios * focal)
            robust = self.valid[rows] / (1.0 + (errors**2).sum(axis=2) / STATIC_SHIFT**2) ** 2
            weights = self.consistent[rows] if step < _STEPS // 2 else robust
            jacobian = jacobian[..., :free]
            weighted = jacobian * weights[..., None, None]
            normal = np.einsum("mnak,mnal->mkl", weighted, jacobian, optimize=True) + 1e-9 * np.eye(free)
            steps = -np.linalg.solve(normal, np.einsum("mnak,mna->mk", weighted, errors, optimize=True)[..., None])
            rotations = Rotation.from_rotvec(steps[:, :3, 0]).as_matrix() @ rotations
            if zooming:
                ratios = ratios * np.exp(np.clip(steps[:, 3, 0], -0.5, 0.5))
        return rotations, ratios


def _rays(places: FloatArray, focal: float) -> FloatArray:
    """Return rays (m, N, 3) through places (m, N, 2) in an image of a focal length."""
    return np.concatenate([places / focal, np.ones((*places.shape[:2], 1))], axis=2)


def _errors(
    rays: FloatArray, end: FloatArray, rotations: FloatArray, focal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the errors (m, N, 2) of turned rays (m, N, 3), and their Jacobian (m, N, 2, 4) by a small rotation after
    the turn and the logarithm of the focal length (m,)."""
    turned = rays @ rotations.swapaxes(1, 2)
    depth = np.maximum(turned[..., 2], 0.1)
    x, y, f = turned[..., 0] / depth, turned[..., 1] / depth, focal[:, None]
    errors = np.stack([f * x, f * y], axis=2) - end
    across = np.stack([-f * x * y, f * (1.0 + x * x), -f * y, f * x], axis=2)
    down = np.stack([-f * (1.0 + y * y), f * x * y, f * x, f * y], axis=2)
    return errors, np.stack([across, down], axis=2)


def _robust_std(distances: FloatArray) -> float:
    """Return the standard deviation of a coordinate from distances (n,) in the plane, at least a tenth of a pixel."""
    return max(float(np.median(distances)) / np.sqrt(2.0 * np.log(2.0)), 0.1 / LONG_SIDE_PX)


def _robust_cost(distances: FloatArray, sigma: float) -> float:
    """Return the Geman–McClure cost of distances (n,), which is quadratic up to about three deviations."""
    squares = (distances / sigma) ** 2
    return float(0.5 * (squares / (1.0 + squares / 9.0)).sum())
