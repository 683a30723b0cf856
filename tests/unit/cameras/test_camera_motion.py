"""The motion of a camera, from images of a textured wall and from exact tracks."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.cameras.background_tracks import LONG_SIDE_PX, STATIC_SHIFT, CornerTracks, track_background
from workbench.cameras.camera import Camera
from workbench.cameras.camera_motion import (
    MAX_LOST,
    MAX_UNEXPLAINED,
    STATIC,
    TRAVELLING,
    TURNING,
    UNKNOWN,
    _errors,
    _Rays,
    _rays,
    _robust_cost,
    _robust_std,
    camera_motion,
    in_camera,
)
from workbench.cameras.person_height import FOCAL_MEDIAN, FOCAL_SPREAD

WIDTH, HEIGHT, FOCAL_PX = 480, 270, 480.0
SIZE, N = (WIDTH, HEIGHT), 25
K = np.array([[FOCAL_PX, 0.0, (WIDTH - 1) / 2], [0.0, FOCAL_PX, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]])
LENS = Camera("camera", WIDTH, HEIGHT, K, np.eye(3), np.zeros(3), np.zeros(5))
NO_PEOPLE = np.empty((0, 22, 3))
WALL_PX = 1200


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def _texture(rng, size=(WALL_PX, WALL_PX)):
    """Return a grey image of blobs with a noise of one grey level in each view."""
    noise = cv2.GaussianBlur(rng.normal(size=size), (0, 0), 2.5)
    return np.clip(128.0 + 40.0 * noise / noise.std(), 0, 255).astype(np.uint8)


def _seen(wall, homography, rng):
    """Return the image of a wall whose middle is the image's middle before the homography."""
    centred = np.array([[1.0, 0.0, (WIDTH - WALL_PX) / 2], [0.0, 1.0, (HEIGHT - WALL_PX) / 2], [0.0, 0.0, 1.0]])
    image = cv2.warpPerspective(wall, homography @ centred, SIZE, flags=cv2.INTER_LINEAR)
    return np.clip(image + rng.normal(scale=1.0, size=image.shape), 0, 255).astype(np.uint8)


def _homography(pan_deg=0.0, tilt_deg=0.0, zoom=1.0):
    """Return K_t R K⁻¹ of a camera that has turned and zoomed."""
    turn = Rotation.from_euler("yx", [-pan_deg, tilt_deg], degrees=True).as_matrix()
    return K @ np.diag([zoom, zoom, 1.0]) @ turn @ np.linalg.inv(K)


def _motion(images, lens=LENS):
    return camera_motion(track_background(images, [NO_PEOPLE] * len(images)), lens)


def _exact(homographies, rng, n=100, moving=0.0):
    """Return tracks of points of the first frame; a fraction of them moves on its own by up to 20 px a frame."""
    start = rng.uniform([0.0, 0.0], SIZE, (n, 2))
    ends = np.stack([cv2.perspectiveTransform(start[:, None], each)[:, 0] for each in homographies])
    own = np.arange(n) < round(moving * n)
    ends[1:, own] += rng.uniform(-20.0, 20.0, (len(ends) - 1, own.sum(), 2))
    starts = np.broadcast_to(start, ends.shape).copy()
    starts[0] = np.nan
    return CornerTracks(SIZE, np.zeros(len(ends), np.int64), starts, ends, np.broadcast_to(~own, ends.shape[:2]))


@pytest.mark.parametrize(("pan_deg", "tilt_deg"), [(12.0, 0.0), (-5.0, 4.0)])
def test_turns_are_measured_from_images(rng, pan_deg, tilt_deg):
    wall, shares = _texture(rng), np.linspace(0.0, 1.0, N)
    motion = _motion([_seen(wall, _homography(pan_deg * share, tilt_deg * share), rng) for share in shares])
    assert motion.kind == TURNING
    expected = Rotation.from_euler("yx", [-pan_deg, tilt_deg], degrees=True)
    error = (Rotation.from_matrix(motion.rotations[-1]) * expected.inv()).magnitude()
    assert np.degrees(error) < 0.1
    assert motion.zooms == pytest.approx(1.0)


def test_a_pan_of_more_than_the_image_is_measured_over_key_frames(rng):
    wall, angles = _texture(rng), np.concatenate([np.linspace(-30.0, 30.0, 60), np.linspace(30.0, -30.0, 60)])
    motion = _motion([_seen(wall, _homography(angle), rng) for angle in angles])
    axes = motion.rotations[:, 2]
    pan = np.degrees(np.arctan2(axes[:, 0], axes[:, 2]))
    assert motion.kind == TURNING
    assert np.ptp(pan) == pytest.approx(60.0, abs=1.0)
    assert pan[-1] == pytest.approx(0.0, abs=0.5)
    assert "pans by" in motion.sentence
    assert "tilts" not in motion.sentence


def test_a_zoom_is_measured_from_images(rng):
    wall = _texture(rng)
    motion = _motion([_seen(wall, _homography(zoom=zoom), rng) for zoom in np.linspace(1.0, 1.4, N)])
    assert motion.kind == TURNING
    assert motion.zooms[-1] == pytest.approx(1.4, rel=0.01)
    assert motion.camera(LENS, 0, N - 1).matrix[0, 0] == pytest.approx(1.4 * FOCAL_PX, rel=0.01)


def test_the_focal_length_follows_from_the_perspective_of_a_wide_pan(rng):
    wall = _texture(rng)
    motion = _motion([_seen(wall, _homography(angle), rng) for angle in np.linspace(-20.0, 20.0, 40)], lens=None)
    assert motion.focal == pytest.approx(FOCAL_PX / WIDTH, rel=0.1)


def test_the_known_camera_turns_with_the_tracks(rng):
    motion = camera_motion(_exact([np.eye(3), _homography(10.0), _homography(10.0), _homography(10.0)], rng), LENS)
    later, point = motion.camera(LENS, 0, 3), np.array([0.3, -0.2, 4.0])
    homogeneous = _homography(10.0) @ np.append(LENS.project(point), 1.0)
    assert later.project(point) == pytest.approx(homogeneous[:2] / homogeneous[2], abs=0.01)
    assert in_camera(later.project(point), later, LENS) == pytest.approx(LENS.project(point))
    assert later.position == pytest.approx(LENS.position)


def test_pixels_are_moved_into_the_middle_of_the_pan(rng):
    angles = np.linspace(0.0, 20.0, 11)
    motion = camera_motion(_exact([_homography(angle) for angle in angles], rng), LENS)
    assert motion.middle == 5
    point = np.array([0.5, 0.3, 4.0])
    seen = np.stack([motion.camera(LENS, 0, t).project(point)[None] for t in range(11)])
    moved, camera = motion.in_middle(np.arange(11), seen, LENS)
    assert moved[:, 0] == pytest.approx(np.tile(camera.project(point), (11, 1)))
    first = motion.in_first(camera, LENS)
    assert first.project(point) == pytest.approx(LENS.project(point))


@pytest.mark.parametrize(("share", "kind"), [(0.7, STATIC), (1.4, TURNING)])
def test_a_camera_stands_still_up_to_the_static_shift(rng, share, kind):
    pan_deg = np.degrees(np.arctan(share * STATIC_SHIFT * WIDTH / FOCAL_PX))
    motion = camera_motion(_exact([np.eye(3), *[_homography(pan_deg)] * 10], rng), LENS)
    assert motion.kind == kind


def test_a_brief_failure_is_no_motion_of_the_camera(rng):
    homographies = [np.eye(3)] * 20
    homographies[10] = homographies[11] = _homography(3.0)
    assert camera_motion(_exact(homographies, rng), LENS).kind == STATIC
    homographies[12] = _homography(3.0)
    assert camera_motion(_exact(homographies, rng), LENS).kind == TURNING


def test_a_camera_stands_still_while_an_object_crosses_a_third_of_the_image(rng):
    wall, other = _texture(rng), _texture(rng)
    images = []
    for t in range(40):
        image = _seen(wall, np.eye(3), rng)
        left = 8 * t
        image[:, left : left + 150] = other[:HEIGHT, : min(150, WIDTH - left)]
        images.append(image)
    motion = _motion(images)
    assert motion.kind == STATIC
    assert "static (the background moved by 0." in motion.sentence


@pytest.mark.parametrize(("moving", "kind"), [(0.9, UNKNOWN), (0.4, STATIC)])
def test_people_who_move_by_themselves_do_not_move_the_camera(rng, moving, kind):
    tracks = _exact([np.eye(3)] * 10, rng, moving=moving)
    if kind == UNKNOWN:  # no homography fits people who walk their own ways, and few points stand still
        tracks = CornerTracks(SIZE, tracks.keys, tracks.start, tracks.end, np.ones(tracks.consistent.shape, bool))
    assert camera_motion(tracks, LENS).kind == kind


@pytest.mark.parametrize(("margin", "kind"), [(-0.05, TURNING), (0.05, UNKNOWN)])
def test_a_turn_explains_most_of_the_background(rng, margin, kind):
    homographies = [_homography(angle) for angle in np.linspace(0.0, 10.0, 10)]
    tracks = _exact(homographies, rng, n=200, moving=MAX_UNEXPLAINED + margin)
    assert camera_motion(tracks, LENS).kind == kind


@pytest.mark.parametrize(("moving", "kind"), [(0.0, TRAVELLING), (0.25, TRAVELLING), (0.4, UNKNOWN)])
def test_a_camera_travels_past_a_scene_of_different_distances(rng, moving, kind):
    start = rng.uniform([0.0, 0.0], SIZE, (120, 2))
    depths = rng.uniform(2.0, 8.0, 120)
    ends = np.stack([start - np.outer(0.04 * t * FOCAL_PX / depths, [1.0, 0.0]) for t in range(20)])
    own = np.arange(120) < 120 * moving
    ends[1:, own] += rng.uniform(-30.0, 30.0, (19, own.sum(), 2))
    starts = np.broadcast_to(start, ends.shape).copy()
    starts[0] = np.nan
    motion = camera_motion(CornerTracks(SIZE, np.zeros(20, np.int64), starts, ends, np.ones((20, 120), bool)), LENS)
    assert motion.kind == kind
    assert ("relative to the camera" in motion.sentence) == (kind == TRAVELLING)
    assert motion.camera(LENS, 0, 10) is LENS


def test_people_who_walk_to_and_fro_do_not_make_a_camera_travel(rng):
    """Half of the tracks are on people who walk towards the camera or away from it, while it turns by 0.3°."""
    homographies = [_homography(0.3 * t / 19) for t in range(20)]
    tracks = _exact(homographies, rng, n=120)
    speeds = rng.uniform(0.3, 1.2, 60) * rng.choice([-1.0, 1.0], 60) * (0.3 + tracks.start[1, :60, 1] / HEIGHT)
    tracks.end[:, :60, 1] += np.arange(20)[:, None] * speeds
    assert camera_motion(tracks, None).kind == UNKNOWN


def test_a_camera_that_travels_is_found_in_images(rng):
    walls = [_texture(rng) for _ in range(3)]
    images = []
    for t in range(30):
        bands = [_seen(wall, np.array([[1.0, 0.0, -t * speed], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), rng)
                 for wall, speed in zip(walls, (1.0, 2.0, 4.0), strict=True)]  # fmt: skip
        images.append(np.concatenate([band[k * 90 : (k + 1) * 90] for k, band in enumerate(bands)]))
    assert _motion(images).kind == TRAVELLING


@pytest.mark.parametrize(("n_marks", "kind"), [(8, UNKNOWN), (12, STATIC)])
def test_ten_corners_are_a_background(rng, n_marks, kind):
    clean = np.full((HEIGHT, WIDTH), 120, np.uint8)
    for k in range(n_marks):
        clean[44 + 80 * (k // 5) :, 44 + 90 * (k % 5) :][:3, :3] = 250  # within one cell of corners
    assert _motion([clean] * 10).kind == kind


@pytest.mark.parametrize(("lost", "kind"), [(MAX_LOST - 0.02, STATIC), (MAX_LOST + 0.02, UNKNOWN)])
def test_frames_without_a_background_are_counted(rng, lost, kind):
    tracks = _exact([np.eye(3)] * 100, rng)
    tracks.keys[1 : 1 + round(100 * lost)] = -1
    assert camera_motion(tracks, LENS).kind == kind


@pytest.mark.parametrize(("zoom", "expected"), [(1.02, False), (1.15, True)])
def test_only_a_clear_zoom_in_a_pan_gets_a_focal_length_for_each_frame(rng, zoom, expected):
    zooms = np.linspace(1.0, zoom, 20)
    homographies = [
        _homography(angle, zoom=each) for angle, each in zip(np.linspace(0.0, 15.0, 20), zooms, strict=True)
    ]
    motion = camera_motion(_exact(homographies, rng), LENS)
    assert motion.kind == TURNING
    assert bool(np.ptp(motion.zooms)) == expected


@pytest.mark.parametrize("zoom", [1.03, 1.15])
def test_a_zoom_without_a_pan_is_compensated(rng, zoom):
    motion = camera_motion(_exact([_homography(zoom=each) for each in np.linspace(1.0, zoom, 20)], rng))
    assert motion.kind == TURNING
    assert motion.zooms[-1] == pytest.approx(zoom, rel=0.005)


@pytest.mark.parametrize(("pan_deg", "tilt_deg", "shift_px"), [(15.0, 0.0, (60.0, 0.0)), (12.0, -10.0, (45.0, -45.0))])
def test_an_off_centre_principal_point_is_no_zoom(rng, pan_deg, tilt_deg, shift_px):
    shift = np.eye(3)
    shift[:2, 2] = shift_px
    turns = [shift @ _homography(k * pan_deg, k * tilt_deg) @ np.linalg.inv(shift) for k in np.linspace(0.0, 1.0, 20)]
    motion = camera_motion(_exact(turns, rng))
    assert motion.kind == TURNING
    assert motion.zooms == pytest.approx(1.0)
    angle_deg = np.degrees(Rotation.from_matrix(motion.rotations[-1]).magnitude())
    assert angle_deg == pytest.approx(np.hypot(pan_deg, tilt_deg), rel=0.1)


def test_tracks_that_do_not_move_leave_the_prior_of_the_focal_length(rng):
    """Between −3 and 3 deviations of a normal distribution the standard deviation is 0.9866."""
    rays = _Rays.of(_exact([np.eye(3)] * 4, rng), None)
    for zooming in (False, True):
        assert rays.estimated_focal(zooming) == pytest.approx((FOCAL_MEDIAN, 0.9866 * FOCAL_SPREAD), rel=5e-3)
    assert rays.off_centre(0.8 * FOCAL_MEDIAN)[1] == pytest.approx(FOCAL_MEDIAN, rel=1e-2)


def test_errors_of_turned_rays_have_their_derivatives(rng):
    places, end, focal = rng.uniform(-0.5, 0.5, (2, 7, 2)), rng.uniform(-0.5, 0.5, (2, 7, 2)), np.array([0.9, 1.3])
    rays, turns = _rays(places, 1.1), Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (2, 3)))
    errors, jacobian = _errors(rays, end, turns.as_matrix(), focal)
    turned = turns.as_matrix()[:, None] @ np.append(places / 1.1, np.ones((2, 7, 1)), axis=2)[..., None]
    np.testing.assert_allclose(errors, focal[:, None, None] * (turned[..., :2, 0] / turned[..., 2:, 0]) - end)
    for k, step in enumerate(1e-6 * np.eye(4)):
        ahead, behind = (
            _errors(
                rays, end, (Rotation.from_rotvec(sign * step[:3]) * turns).as_matrix(), focal * np.exp(sign * step[3])
            )[0]
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(jacobian[..., k], (ahead - behind) / 2e-6, atol=1e-8)


def test_robust_deviations_and_costs(rng):
    """Distances in the plane of normal coordinates have a Rayleigh distribution."""
    assert _robust_std(rng.rayleigh(0.02, 10_000)) == pytest.approx(0.02, rel=0.05)
    assert _robust_std(np.zeros(3)) == 0.1 / LONG_SIDE_PX
    assert _robust_cost(np.array([0.0, 0.06, 0.12]), 0.02) == pytest.approx(4.5 * (0.5 + 0.8))


def test_people_and_logos_are_no_background(rng):
    wall, logo = _texture(rng), _texture(rng)
    images = []
    for t in range(30):
        image = _seen(wall, _homography(0.8 * t), rng)
        image[200:, 360:] = logo[: HEIGHT - 200, : WIDTH - 360]
        image[60:240, 150:250] = logo[60:240, 150:250]
        images.append(image)
    joints = np.full((1, 22, 3), np.nan)
    joints[0, :4, :2] = [[165.0, 75.0], [235.0, 75.0], [165.0, 225.0], [235.0, 225.0]]
    tracks = track_background(images, [joints] * 30)
    inside = (np.abs(tracks.start - [200.0, 150.0]) < [35.0, 75.0]).all(axis=2)
    assert not inside.any()
    motion = camera_motion(tracks, LENS)
    expected = Rotation.from_euler("y", -0.8 * 29, degrees=True)
    assert np.degrees((Rotation.from_matrix(motion.rotations[-1]) * expected.inv()).magnitude()) < 0.3
