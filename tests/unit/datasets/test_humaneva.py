"""HumanEva: generated folders in its format against an independent computation of its truth, protocol and error."""

import humaneva_files
import numpy as np
import pytest
from humaneva_files import GAP, OFFSETS, RADII_MM, SKELETON, cameras, write
from openpose_scenes import points as openpose_points
from openpose_scenes import write as write_openpose

from tests.oracles import humaneva as oracle
from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import HUMANEVA_HEAD_M
from workbench.datasets.humaneva import HumanEva
from workbench.evaluation.errors.pose_errors import humaneva_errors
from workbench.utils.errors import InputError

pytestmark = pytest.mark.usefixtures("trusted")
FIRST = 6  # the benchmark's first frame, from 1
N = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a data set with one trial of S1 and of S3, and the points of the capture, m."""
    place = tmp_path_factory.mktemp("humaneva")
    points = write(place)
    write(place, "S3")
    return place, points


def dataset(folder, **options):
    return HumanEva(folder=str(folder), **{"n_frames": N} | options)


def true_markers(points, number, offsets=OFFSETS):
    """Return the virtual markers by name, mm, of a frame, from 1."""
    _, row, scale = oracle.first_images_and_row(offsets)
    millimetres = {name: 1e3 * each for name, each in points.items()}
    radius = 0.5 * np.linalg.norm(millimetres["LSHO"][0] - millimetres["RSHO"][0]) - 7.0
    return oracle.markers_mm(millimetres, row - 1.0 + (number - 1) * scale, radius, RADII_MM)


def test_cameras_and_images_belong_together_as_in_the_benchmark(folder):
    eva = dataset(folder[0], cameras=["C1", "C2", "C3", "BW1"])
    starts, _, _ = oracle.first_images_and_row(OFFSETS)
    assert len(set(starts.values())) > 2  # or else nothing is tested
    frames = list(eva.frames())
    assert len(frames) == eva.info.n_frames == N
    for k, frame in enumerate(frames):
        for view, (name, start) in zip(frame.views, starts.items(), strict=True):
            image = start - 1 + FIRST - 1 + k
            assert (view.camera.name, round(float(view.image.mean()) / 8.0)) == (name, image)
        assert frame.index == starts["C1"] - 1 + FIRST - 1 + k
    np.testing.assert_allclose(np.diff([frame.time_s for frame in frames]), 1.0 / 60.0)
    known = cameras()
    places = np.random.default_rng(0).uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.8], (20, 3))
    for camera in eva.info.cameras:
        undistorted = camera.project(places)
        np.testing.assert_allclose(undistorted, known[camera.name].project(places), atol=1e-6)


def test_the_truth_is_the_benchmarks(folder):
    frames = list(dataset(folder[0]).frames())
    invalid = []
    for k, frame in enumerate(frames):
        expected = true_markers(folder[1], FIRST + k)
        if expected is None:
            invalid.append(k)
            assert frame.truth is None
            continue
        for joint, ends in oracle.PAIRS.items():
            both = 1e3 * frame.truth.virtual_markers[JOINT_NAMES.index(joint)]
            np.testing.assert_allclose(both, [expected[ends[0]], expected[ends[-1]]], atol=1e-6)
    _, row, scale = oracle.first_images_and_row(OFFSETS)
    rows = row - 1.0 + (FIRST - 1 + np.arange(N)) * scale
    assert invalid == np.flatnonzero((np.floor(rows) == GAP[0]) | (np.ceil(rows) == GAP[0])).tolist() != []


def test_the_joints_of_the_truth_are_the_persons(folder):
    """The pelvis is between the hips and the head's centre between its markers; arms differ by the tilt of 2 cm."""
    eva = dataset(folder[0])
    _, row, scale = oracle.first_images_and_row(OFFSETS)
    for k, frame in enumerate(eva.frames()):
        if frame.truth is None:
            continue
        at = row - 1.0 + (FIRST - 1 + k) * scale
        true = joints(SKELETON, humaneva_files.poses())[[int(np.floor(at)), int(np.ceil(at))]]
        true = true[0] + (at - np.floor(at)) * (true[1] - true[0])
        distances = dict(zip(JOINT_NAMES, np.linalg.norm(frame.truth.joints - true, axis=1), strict=True))
        assert max(distances[name] for name in JOINT_NAMES if name.endswith(("hip", "knee", "ankle", "pelvis"))) < 1e-3
        assert max(distances[name] for name in JOINT_NAMES if name.endswith(("elbow", "wrist"))) < 0.05


@pytest.mark.parametrize("with_cameras", [False, True])
def test_the_error_is_the_benchmarks(folder, with_cameras, monkeypatch):
    frame = next(dataset(folder[0]).frames())
    rng, expected, markers = (
        np.random.default_rng(1),
        true_markers(folder[1], FIRST),
        frame.truth.virtual_markers.copy(),
    )
    markers[JOINT_NAMES.index("left_knee"), 0] = np.nan  # the joint has no error
    monkeypatch.delitem(oracle.PAIRS, "left_knee")
    estimate = joints(SKELETON, humaneva_files.poses()[:1])[0] + rng.normal(0.0, 0.05, (len(JOINT_NAMES), 3))
    places = dict(zip(JOINT_NAMES, estimate, strict=True))
    upwards = places["head_centre"] - places["neck"]
    places["head_centre"] = places["neck"] + HUMANEVA_HEAD_M * upwards / np.linalg.norm(upwards)
    errors = humaneva_errors(frame, estimate, markers, image_scale=0.5)
    if not with_cameras:
        in_mm = oracle.error({name: 1e3 * place for name, place in places.items()}, expected)
        assert errors["humaneva_mm"] == pytest.approx(in_mm, abs=1e-6)
        return
    of_views = []
    for view in frame.views:
        pixels = {name: view.camera.project(place[None])[0] for name, place in places.items()}
        true = {name: view.camera.project(1e-3 * place[None])[0] for name, place in expected.items()}
        of_views.append(oracle.error(pixels, true))
    assert errors["humaneva_px"] == pytest.approx(np.mean(of_views) / 0.5, abs=1e-6)


def test_the_initial_pose_and_the_lengths_are_true(folder):
    eva = dataset(folder[0], initialization="truth", n_frames=3)
    first = next(eva.frames())
    body = person(eva.info.shape)
    assert isinstance(body, Body)
    fitted = joints(body.skeleton, eva.info.initial_pose[None])[0]
    assert 1e3 * np.linalg.norm(fitted - first.truth.joints, axis=1).mean() < 25.0  # arms are tilted by 2 cm
    true = from_height(1.75)
    assert eva.info.shape.thigh == pytest.approx(true.thigh, abs=1e-3)
    assert eva.info.shape.shoulder[1] == pytest.approx(true.shoulder[1], abs=1e-3)


def test_a_sequence_with_the_true_pose_begins_at_a_valid_frame(tmp_path):
    _, row, scale = oracle.first_images_and_row(OFFSETS)
    write(tmp_path, gap=(round(row - 1.0 + (FIRST - 1) * scale), "C7"))
    assert next(dataset(tmp_path).frames()).truth is None
    eva = dataset(tmp_path, initialization="truth", n_frames=4)
    frames = list(eva.frames())
    assert frames[0].truth is not None
    assert frames[0].index == next(dataset(tmp_path).frames()).index + 1
    assert len(frames) == 4


def test_the_head_of_s3_is_no_truth(folder):
    truth = next(dataset(folder[0], subject="S3").frames()).truth
    head = JOINT_NAMES.index("head_centre")
    assert np.isnan(truth.joints[head]).all()
    assert np.isnan(truth.virtual_markers[head]).all()
    assert np.isfinite(np.delete(truth.virtual_markers, head, axis=0)).all()


def test_keypoints_of_each_camera_are_those_of_its_image(folder, tmp_path):
    starts, row, scale = oracle.first_images_and_row(OFFSETS)
    places = joints(SKELETON, humaneva_files.poses())

    def pixels(name, image):
        """Return the true joints in an image, from 0, at the nearest captured row."""
        return cameras()[name].project(places[round(row - 1.0 + (image - (starts[name] - 1)) * scale)])

    for name in ("C1", "C2"):
        people = {
            image: [openpose_points("BODY_25", dict(zip(JOINT_NAMES, pixels(name, image), strict=True)))]
            for image in range(starts[name] - 1, 30)
        }
        write_openpose(tmp_path / name, people)
    eva = dataset(folder[0], cameras=["C1", "C2"], keypoints={name: str(tmp_path / name) for name in ("C1", "C2")})
    assert eva.info.has_keypoints
    wrist = JOINT_NAMES.index("right_wrist")
    for k, frame in enumerate(eva.frames()):
        for view in frame.views:
            name, image = view.camera.name, starts[view.camera.name] - 1 + FIRST - 1 + k
            np.testing.assert_allclose(view.keypoints[wrist, :2], pixels(name, image)[wrist], atol=1e-3)


def test_the_second_data_set_has_folders_of_images_and_its_own_frames(tmp_path):
    import cv2

    write(tmp_path, "S2", "Combo_1", offsets={name: OFFSETS[name] for name in ("C1", "C2")})
    for name in ("C1", "C2"):
        images = tmp_path / "S2" / "Image_Data" / f"Combo_1_({name})"
        images.mkdir()
        for k in range(12):
            cv2.imwrite(str(images / f"{k:06d}.png"), np.full((120, 160, 3), 4 * k, np.uint8))
    eva = dataset(tmp_path, subject="S2", action="Combo", trial=1, partition="test", cameras=["C1", "C2"], n_frames=3)
    starts = oracle.first_images_and_row({name: OFFSETS[name] for name in ("C1", "C2")})[0]
    frame = next(eva.frames())
    assert [round(float(view.image.mean()) / 4.0) for view in frame.views] == [starts["C1"] - 1, starts["C2"] - 1]


@pytest.mark.parametrize(
    ("options", "span"),
    [
        ({}, (6, 590)), ({"partition": "train"}, (591, 1203)), ({"partition": "test"}, (6, 1004)),
        ({"subject": "S3", "action": "Box"}, (6, 512)), ({"subject": "S4", "partition": "test"}, (6, 667)),
        ({"subject": "S4", "action": "Combo", "trial": 4, "partition": "test"}, (2, 1258)),
    ],
)  # fmt: skip
def test_partitions(options, span):
    assert HumanEva(folder="x", **options)._span == span


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"subject": "S4"}, "there is no Walking of S4 in partition=validate"),
        ({"action": "Combo"}, "there is no Combo of S1 in partition=validate"),
        ({"action": "Run"}, "there is no Run of S1"),
        ({"partition": "all"}, "partition must be one of validate, train, test"),
        ({"trial": 2}, "expected S2 Combo 1 or S4 Combo 4, found S1 Walking 2"),
        ({"subject": "S2", "action": "Combo", "trial": 1}, "HumanEva II has partition=test only"),
        ({"cameras": ["C9"]}, "cameras: expected some of C1, C2"),
    ],
)
def test_unknown_trials_are_rejected(options, message):
    with pytest.raises(InputError, match=message):
        HumanEva(folder="x", **options)


def test_a_capture_is_optional_but_for_the_true_pose(tmp_path):
    write(tmp_path)
    (tmp_path / "S1" / "Mocap_Data" / "Walking_1.c3d").unlink()
    assert all(frame.truth is None for frame in dataset(tmp_path).frames())
    with pytest.raises(InputError, match=r"Walking_1\.c3d: expected a frame with all markers for the initial pose"):
        _ = dataset(tmp_path, initialization="truth").info


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("Sync_Data/Walking_1_(C2).ofs", None, r"C2\)\.ofs: no such file; expected the synchronization"),
        (
            "Sync_Data/Walking_1_(C2).ofs",
            "1 2",
            r"C2\)\.ofs, line 1: expected 3 values for the synchronization, found 2",
        ),
        ("Sync_Data/Walking_1_(C2).ofs", "1 2 0", r"C2\)\.ofs: expected a positive number of captured rows per image"),
        ("Mocap_Data/S1.mp", "$LKneeWidth = 3", r"S1\.mp: expected a line \$LShoulderOffset = millimetres"),
        ("Mocap_Data/S1.mp", None, r"S1\.mp"),
        ("Mocap_Data/Static.c3d", None, r"Static\.c3d"),
        ("Image_Data/Walking_1_(C2).avi", None, r"C2\)\.avi: no such video file"),
        ("Calibration_Data/C2.cal", None, "C2"),
    ],
)
def test_a_missing_or_damaged_file_is_named(tmp_path, name, content, message):
    write(tmp_path)
    path = tmp_path / "S1" / name
    path.unlink() if content is None else path.write_text(content)
    with pytest.raises(InputError, match=message):
        list(dataset(tmp_path, initialization="truth").frames())


def test_names_of_the_forearms_markers_differ_between_subjects(tmp_path):
    write(tmp_path, renamed={"LFRM": "LFRA", "RFRM": "RFRA"})
    assert next(dataset(tmp_path).frames()).truth is not None
    write(tmp_path, renamed={"LFEO": "LFXX"})
    with pytest.raises(
        InputError, match=r"Walking_1\.c3d: expected Plug-in Gait's markers and segments, .+, found no LFEO"
    ):
        list(dataset(tmp_path).frames())
