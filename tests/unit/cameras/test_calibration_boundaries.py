"""Findings on a calibration on both sides of every threshold, by exact keypoints of a person of known size."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import HEIGHT_M, camera_arc, observed_joints

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT, from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.calibration_findings import check_calibration, distance, lens_findings, upright
from workbench.cameras.camera import plain_camera
from workbench.utils.finding import DOUBTFUL, LEVELS, NOT_USABLE, NOTE, TRUSTWORTHY

SIDES = ("left", "right")
HEAD = JOINT_NAMES.index("head_centre")
ANKLES = [JOINT_NAMES.index(f"{side}_ankle") for side in SIDES]
SHOULDERS = [JOINT_NAMES.index(f"{side}_shoulder") for side in SIDES]
UPPER = [k for k in range(len(JOINT_NAMES)) if not {"hip", "knee", "ankle"} & set(JOINT_NAMES[k].split("_"))]


def standing(floor_m=0.0, places=((0.0, 0.0),)):
    """Return joints (F, J, 3), m, of a person 1.70 m tall who stands upright at places (x, y) on a floor."""
    body = joints(person(from_height(HEIGHT_M)).skeleton, np.zeros((1, 25)))[0]
    body[HEAD, :2] = body[ANKLES, :2].mean(axis=0)
    body = body - [0.0, 0.0, body[ANKLES[0], 2] - 0.039 * HEIGHT_M - floor_m]
    return body + np.pad(np.asarray(places, float), ((0, 0), (0, 1)))[:, None]


def observed(cameras, points, true_cameras=None):
    return observed_joints(cameras, true_cameras, sigma_px=0.0, points=points)


def level(seen, kind, height_m=HEIGHT_M):
    """Return the worst level of the findings of a kind, None without any that is judged."""
    findings = check_calibration(seen, height_m).findings
    return max((each.level for each in findings if each.kind == kind and each.level != NOTE), key=LEVELS.index,
               default=None)  # fmt: skip


def is_problem(*args):
    return level(*args) in (DOUBTFUL, NOT_USABLE)


def turned(camera, degrees, axis):
    """Return the camera turned about its own x or z axis at the same place."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis]
    return camera.turned(np.array(turn, float), 1.0)


@pytest.mark.parametrize(("ratio", "problem"), [(0.39, True), (0.41, False), (4.9, False), (5.1, True)])
def test_the_focal_length_is_between_04_and_5_sides_of_the_image(ratio, problem):
    camera = plain_camera(1000, 800, 1000.0 * ratio, (-5.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    assert [each.kind for each in lens_findings(camera) if each.is_problem] == ["focal length"] * problem


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("offset", "problem"), [(0.1199, False), (0.1201, True), (-0.1199, False), (-0.1201, True)])
def test_the_principal_point_is_within_012_of_the_image_size_from_its_middle(axis, offset, problem):
    camera = plain_camera(1000, 800, 900.0, (-5.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    camera.matrix[axis, 2] += offset * (1000, 800)[axis]
    assert [each.kind for each in lens_findings(camera) if each.is_problem] == ["image size"] * problem


@pytest.mark.parametrize(("metres", "problem"), [(0.29, True), (0.31, False), (99.0, False), (101.0, True)])
def test_a_person_is_03_to_100_metres_away(metres, problem):
    camera = plain_camera(1280, 960, 900.0, (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
    finding = distance(camera, np.tile([metres, 0.2, 0.0], (3, 1)))
    assert finding.level == (NOT_USABLE if problem else TRUSTWORTHY)


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [(19.9, TRUSTWORTHY), (20.1, DOUBTFUL), (59.9, DOUBTFUL), (60.1, DOUBTFUL), (119.9, DOUBTFUL), (120.1, NOT_USABLE)],
)
def test_a_person_leans_by_20_degrees_and_is_upside_down_from_120_degrees_on(degrees, expected):
    axis = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    finding = upright(axis, axis, "")
    assert finding.level == expected
    assert ("lies" in finding.message) == (60.0 < degrees < 120.0)


def test_the_less_inclined_of_body_and_trunk_counts():
    up, ahead = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0])
    assert upright(ahead, up, "").level == upright(up, ahead, "").level == TRUSTWORTHY  # sits, bends
    assert upright(ahead, ahead, "").level == DOUBTFUL


@pytest.mark.parametrize(
    ("degrees", "expected"), [(19.5, TRUSTWORTHY), (20.5, DOUBTFUL), (119.5, DOUBTFUL), (120.5, NOT_USABLE)]
)
def test_one_camera_is_rolled_by_up_to_20_and_120_degrees(degrees, expected):
    camera = plain_camera(1280, 960, 9000.0, (0.0, -50.0, 0.8), (0.0, 0.0, 0.8))  # a far one, in which verticals do
    rolled = turned(camera, degrees, "z")  # not converge
    assert level(observed([rolled], standing(), [camera]), "vertical") == expected


@pytest.mark.parametrize(
    ("height_m", "expected"),
    [(0.59, NOT_USABLE), (0.61, DOUBTFUL), (1.19, DOUBTFUL), (1.21, TRUSTWORTHY), (2.19, TRUSTWORTHY), (2.21, DOUBTFUL),
     (3.29, DOUBTFUL), (3.31, NOT_USABLE)],
)  # fmt: skip
def test_heights_of_unknown_people_are_12_to_22_metres(height_m, expected):
    points = standing() * height_m / HEIGHT_M
    assert level(observed(camera_arc(2), points), "height mismatch", None) == expected


@pytest.mark.parametrize("is_taller", [False, True])
@pytest.mark.parametrize(
    ("factor", "expected"), [(1.099, TRUSTWORTHY), (1.101, DOUBTFUL), (1.249, DOUBTFUL), (1.251, NOT_USABLE)]
)
def test_limbs_differ_from_the_height_by_up_to_10_and_25_percent(factor, expected, is_taller):
    height_m = HEIGHT_M * factor if is_taller else HEIGHT_M / factor
    assert level(observed(camera_arc(2), standing()), "height mismatch", height_m) == expected


@pytest.mark.parametrize(
    ("height", "is_unit"),
    [(44.0, False), (46.0, True), (239.0, True), (241.0, False), (440.0, False), (460.0, True), (2390.0, True),
     (2410.0, False)],
)  # fmt: skip
def test_a_person_is_45_to_240_centimetres_tall_in_another_unit(height, is_unit):
    factor = height / HEIGHT_M
    cameras = [replace(camera, translation=factor * camera.translation) for camera in camera_arc(2)]
    seen = observed(cameras, factor * standing())
    assert is_problem(seen, "unit of length") == is_unit
    assert is_problem(seen, "height mismatch") != is_unit
    for z, units in ((height / HEIGHT_M * 1.4, is_unit), (1.4, False)):  # one camera measures its height by the person
        camera = plain_camera(1280, 960, 900.0, (0.0, -5.0, z), (0.0, 0.0, z))
        lower = observed([camera], standing(z - 1.4))
        assert is_problem(lower, "unit of length") == units


@pytest.mark.parametrize(
    ("above_mm", "is_unit"), [(0.36, False), (0.38, True), (1.97, True), (1.99, False), (0.0, False)]
)
def test_a_height_of_a_camera_in_kilometres_is_no_origin(above_mm, is_unit):
    """At 1.4 m above the feet of a person of 1.7 m: 0.45 m to 2.4 m times 1.4 / 1.7."""
    camera = plain_camera(1280, 960, 900.0, (0.0, 0.0, 1e-3 * above_mm), (0.0, 5.0, 1e-3 * above_mm))
    seen = observed([camera], standing(1e-3 * above_mm - 1.4, [(0.0, 5.0)]))
    assert is_problem(seen, "unit of length") == is_unit


@pytest.mark.parametrize("tilted_m", [1.4, 4.0])
@pytest.mark.parametrize(("hips", "is_known"), [(0.40, False), (0.42, True)])
def test_a_person_is_upright_from_hips_at_041_of_the_height_on(hips, is_known, tilted_m):
    """Above the ankles; others show no floor."""
    points = standing()
    for side in SIDES:
        hip, ankle = (JOINT_NAMES.index(f"{side}_{name}") for name in ("hip", "ankle"))
        points[:, hip] = points[:, ankle] + [0.0, 0.0, hips * HEIGHT_M]
    camera = plain_camera(1280, 960, 900.0, (0.0, -5.0, tilted_m), (0.0, 0.0, 1.0))
    check = check_calibration(observed([camera], points), HEIGHT_M)
    assert (check.floor_m is not None) == is_known
    assert check.floor_m is None or check.floor_m == pytest.approx(0.0, abs=0.01)


def test_a_floor_is_that_of_the_frames_in_which_the_person_is_upright():
    sitting = standing(places=[(0.0, 0.0)] * 4)
    sitting[1:, UPPER, 2] -= 0.4
    sitting[1:, [JOINT_NAMES.index(f"{side}_hip") for side in SIDES], 2] -= 0.4
    camera = plain_camera(1280, 960, 900.0, (0.0, -5.0, 1.4), (0.0, 0.0, 1.0))
    check = check_calibration(observed([camera], sitting), HEIGHT_M)
    assert check.floor_m == pytest.approx(0.0, abs=0.01)
    head, ankle = (check.joints[0, JOINT_NAMES.index(name), 2] for name in ("head_centre", "left_ankle"))
    assert head - ankle == pytest.approx((HEAD_HEIGHT - ANKLE_HEIGHT) * HEIGHT_M)


@pytest.mark.parametrize("n_cameras", [1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("camera_m", "floor_m", "problem"), [(0.0, 0.14, False), (0.0, 0.16, True), (3.0, 0.44, False), (3.0, 0.46, True)]
)
def test_the_floor_is_within_15_centimetres_and_a_tenth_of_the_cameras_height(
    n_cameras, sign, camera_m, floor_m, problem
):
    places = [(-1.0, -5.0, camera_m), (2.0, -5.0, camera_m)][:n_cameras]
    cameras = [plain_camera(1280, 960, 900.0, place, (0.0, 0.0, 1.0), f"c{k}") for k, place in enumerate(places)]
    assert is_problem(observed(cameras, standing(sign * floor_m)), "ground contact") == problem


@pytest.mark.parametrize("n_cameras", [1, 2])
@pytest.mark.parametrize(("camera_m", "problem"), [(0.14, False), (0.16, True)])
def test_a_world_that_begins_within_15_centimetres_of_a_camera_has_no_floor(n_cameras, camera_m, problem):
    places = [(0.0, 0.0, camera_m), (4.0, 0.0, 0.0)][:n_cameras]
    cameras = [plain_camera(1280, 960, 900.0, place, (2.0, 5.0, 0.0), f"c{k}") for k, place in enumerate(places)]
    assert is_problem(observed(cameras, standing(-1.0, [(2.0, 5.0)])), "ground contact") == problem


@pytest.mark.parametrize(("floor_m", "problem"), [(0.49, False), (0.51, True)])
def test_feet_half_a_metre_above_the_only_camera_contradict_it(floor_m, problem):
    camera = plain_camera(1280, 960, 900.0, (0.0, 0.0, 0.0), (0.0, 5.0, 1.0))  # without a floor of its own
    assert is_problem(observed([camera], standing(floor_m, [(0.0, 5.0)])), "ground contact") == problem


@pytest.mark.parametrize(("n_low", "problem"), [(5, False), (6, True)])
def test_the_lowest_twentieth_of_the_ankles_is_below_the_floor(n_low, problem):
    points = standing(places=np.zeros((100, 2)))
    points[:n_low, :, 2] -= 2.0  # the persons below, of 100
    assert is_problem(observed(camera_arc(2), points), "ground contact") == problem


WALK = np.linspace(0.0, 3.0, 10)


def walk_away(y=WALK, slope_deg=0.0, raised_m=0.0):
    """Return keypoints of a person who walks to places (n,), m, away from a camera, on a slope with steps (n,), m."""
    points = standing(places=np.column_stack([np.zeros(len(y)), y]))
    points[..., 2] += (np.tan(np.radians(slope_deg)) * np.asarray(y) + raised_m)[:, None]
    return observed([plain_camera(1280, 960, 900.0, (0.0, -6.0, 1.4), (0.0, 0.0, 1.0))], points)


def slope_level(seen):
    """Return the level of the finding on the floor's slope, None without one."""
    findings = check_calibration(seen, HEIGHT_M).findings
    return next((each.level for each in findings if "slope" in each.message), None)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("degrees", "expected"), [(4.9, TRUSTWORTHY), (5.1, DOUBTFUL)])
def test_the_floor_slopes_by_up_to_5_degrees(degrees, expected, sign):
    assert slope_level(walk_away(slope_deg=sign * degrees)) == expected


@pytest.mark.parametrize(("degrees", "expected"), [(6.9, TRUSTWORTHY), (7.1, DOUBTFUL)])
def test_the_slope_is_known_to_two_standard_deviations(degrees, expected):
    y = np.linspace(0.0, 3.0, 12)
    raised = np.tile([1.0, -1.0, -1.0, 1.0], 3)  # without a slope and a mean
    # The standard deviation of the slope, the root of the mean squared residual over the spread, is 1°.
    size = np.tan(np.radians(1.0)) * np.sqrt(((y - y.mean()) ** 2).sum() * 10 / 12)
    assert slope_level(walk_away(y, degrees, size * raised)) == expected


@pytest.mark.parametrize(
    ("walk_m", "n", "has_slope"), [(0.98, 9, False), (1.02, 9, True), (3.0, 2, False), (3.0, 3, True)]
)
def test_a_slope_is_estimated_from_three_frames_over_a_metre(walk_m, n, has_slope):
    assert (slope_level(walk_away(np.linspace(0.0, walk_m, n))) is not None) == has_slope


@pytest.mark.parametrize(("walk_m", "has_slope"), [(0.0, False), (0.98, False), (1.02, True)])
def test_a_person_who_bends_does_not_walk_away(walk_m, has_slope):
    seen = walk_away(np.linspace(0.0, walk_m, 12))
    feet = seen.keypoints[0][:, ANKLES, :2].mean(axis=1, keepdims=True)
    shorter = np.where(np.arange(12) < 7, 1.0, 0.7)[:, None, None]  # as if 2.6 m farther away
    seen.keypoints[0][..., :2] = feet + shorter * (seen.keypoints[0][..., :2] - feet)
    assert (slope_level(seen) is not None) == has_slope


@pytest.mark.parametrize(("clearance", "has_slope"), [(0.099, True), (0.101, False)])
def test_feet_on_the_ground_are_level_within_a_tenth_of_the_height(clearance, has_slope):
    seen = walk_away()
    ankles, shoulders = (seen.keypoints[0][:, pair, 1].mean(axis=1) for pair in (ANKLES, SHOULDERS))
    tall = (ankles - shoulders) / (0.818 - 0.039)  # the heights of shoulders and ankles over that of the person
    for ankle, sign in zip(ANKLES, (-0.5, 0.5), strict=True):
        seen.keypoints[0, :, ankle, 1] = ankles + sign * clearance * tall
    assert (slope_level(seen) is not None) == has_slope


@pytest.mark.parametrize(("degrees", "has_slope"), [(9.9, True), (10.1, False)])
def test_a_trunk_over_the_feet_leans_by_up_to_10_degrees(degrees, has_slope):
    y, leans = np.linspace(0.0, 2.0, 20), np.arange(20) >= 11
    y[:11] *= 0.5  # those who are upright, the majority, walk half a metre, and all of them two
    seen = walk_away(y=y)
    above = seen.keypoints[0][:, ANKLES, 1].mean(axis=1, keepdims=True) - seen.keypoints[0][:, UPPER, 1]
    seen.keypoints[0][:, UPPER, 0] += np.where(leans, np.tan(np.radians(degrees)), 0.0)[:, None] * above
    assert (slope_level(seen) is not None) == has_slope


@pytest.mark.parametrize(("n_frames", "expected"), [(1, TRUSTWORTHY), (10, NOT_USABLE)])
def test_a_person_upside_down_in_one_frame_of_ten_is_no_wrong_vertical(n_frames, expected):
    seen = walk_away()
    bodies = seen.keypoints[0, :n_frames]
    bodies[:, [*ANKLES, HEAD], 1] = bodies[:, [HEAD, HEAD, ANKLES[0]], 1]
    assert level(seen, "vertical") == expected


@pytest.mark.parametrize(
    ("share", "expected"), [(0.034, TRUSTWORTHY), (0.036, DOUBTFUL), (0.119, DOUBTFUL), (0.121, NOT_USABLE)]
)
def test_cameras_agree_within_0035_and_012_of_the_persons_height(share, expected):
    seen = observed(camera_arc(2), standing(places=[(0.5, -1.0)]))
    for v, sign in enumerate((-1.0, 1.0)):  # so that the true joints are in the middle of the rays
        seen.keypoints[v, ..., 1] += sign * share * np.ptp(seen.keypoints[v, 0, :, 1])
    assert level(seen, "inconsistent cameras") == expected


@pytest.mark.parametrize(("n_outside", "problem"), [(7, False), (8, True)])
def test_half_of_the_keypoints_lie_inside_of_the_image(n_outside, problem):
    seen = observed(camera_arc(1), standing())
    seen.keypoints[0, 0, 14:] = np.nan  # 14 are left
    seen.keypoints[0, 0, :n_outside, 0] -= 1280.0
    assert is_problem(seen, "keypoints outside the image") == problem


@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize(
    ("axis", "pixel", "problem"),
    [(0, -0.45, False), (0, -0.55, True), (0, 1279.45, False), (0, 1279.55, True), (1, -0.45, False),
     (1, -0.55, True), (1, 959.45, False), (1, 959.55, True)],
)  # fmt: skip
def test_the_image_ends_half_a_pixel_beyond_the_centres_of_its_outer_pixels(axis, pixel, problem, scale):
    (camera,) = camera_arc(1)
    seen = replace(observed([camera.scaled(scale)], standing()), scale=scale)
    seen.keypoints[..., axis] = (pixel + 0.5) * scale - 0.5
    assert is_problem(seen, "keypoints outside the image") == problem


@pytest.mark.parametrize(
    ("low", "high", "problem"), [(-0.49, 1.49, True), (-0.51, 1.0, False), (0.0, 1.51, False), (1.51, 1.52, False)]
)
def test_fractions_of_the_image_are_0_to_1_with_half_a_pixel(low, high, problem):
    seen = observed(camera_arc(1), standing())
    seen.keypoints[..., :2] = np.linspace(high, low, 15)[:, None]
    assert is_problem(seen, "keypoints outside the image") == problem


@pytest.mark.parametrize(("weight", "counts"), [(0.29, False), (0.31, True)])
def test_joints_of_a_weight_of_03_are_triangulated(weight, counts):
    seen = observed(camera_arc(2), standing())
    seen.keypoints[1, ..., 2] = weight
    assert np.isfinite(check_calibration(seen, HEIGHT_M).joints).any() == counts
    assert is_problem(seen, "inconsistent cameras") != counts
