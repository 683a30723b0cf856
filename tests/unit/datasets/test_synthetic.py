"""Synthetic scenes: ground truth, automatic cameras, the cache of images, and keypoints."""

import warnings

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.datasets import synthetic
from workbench.datasets.synthetic import Synthetic
from workbench.motion.library import write_library
from workbench.motion.synthetic.gait import builtin_motions
from workbench.utils.errors import InputError

SMALL = {"n_frames": 3, "width": 160, "height": 120, "person_px": 70.0, "focal_px": 175.0}


def scene(**parameters):
    """Return a dataset without perturbations, which test_perturbations tests."""
    return Synthetic(**{**SMALL, "perturb": False, **parameters})


def images(dataset):
    return np.stack([frame.views[0].image for frame in dataset.frames()])


def test_frames_have_images_and_the_ground_truth():
    dataset = scene(first_frame=7, rate_hz=25.0)
    frames = list(dataset.frames())
    assert len(frames) == dataset.info.n_frames == 3
    assert [frame.index for frame in frames] == [7, 8, 9]
    assert frames[1].time_s == pytest.approx(8 / 25.0)
    for frame in frames:
        assert frame.views[0].image.shape == (120, 160)
        assert frame.views[0].image.dtype == np.uint8
        expected = joints(person_skeleton(dataset.info.shape), frame.truth.pose[None])[0]
        assert np.array_equal(frame.truth.joints, expected)
    assert np.array_equal(dataset.info.initial_pose, frames[0].truth.pose)


def test_the_rendered_person_surrounds_the_projected_joints():
    """Pixels of the person differ from the uniform background."""
    dataset = scene(noise_std=0.0, clutter=0.0, n_frames=2)
    frame = next(dataset.frames())
    rows, columns = np.nonzero(frame.views[0].image != 125)
    pixels = dataset.true_camera.project(frame.truth.joints)
    radius_px = 70.0 / 1.75 * dataset.info.shape.head_radius + 1.0  # largest distance of the outline from a joint
    head = JOINT_NAMES.index("head_centre")
    assert rows.min() == pytest.approx(pixels[head, 1] - radius_px, abs=2.0)
    assert columns.min() > pixels[:, 0].min() - radius_px
    assert columns.max() < pixels[:, 0].max() + radius_px
    assert rows.max() - rows.min() == pytest.approx(70.0, abs=3.0)  # person_px, with vertical motion of the walk


@pytest.mark.parametrize("view_azimuth_deg", [0.0, 45.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("path", ["straight", "circle"])
def test_the_automatic_camera_shows_all_frames_from_its_azimuth(path, view_azimuth_deg):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # views along the walk need a larger distance
        dataset = scene(n_frames=40, path=path, view_azimuth_deg=view_azimuth_deg)
    camera, motion = dataset.true_camera, dataset._used_motion
    pixels = camera.project(joints(person_skeleton(dataset.info.shape), motion.poses))
    assert (pixels > 0.05 * np.array([160, 120]) - 1.0).all()
    assert (pixels < 0.95 * np.array([160, 120])).all()
    walk, view = motion.poses[-1, :2] - motion.poses[0, :2], camera.rotation[2, :2]
    angle = np.degrees(np.arctan2(walk[0] * view[1] - walk[1] * view[0], walk @ view))
    assert (angle - view_azimuth_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-6)
    assert camera.rotation[2, 2] == pytest.approx(0.0)  # level


def test_images_are_reproducible_and_depend_on_every_parameter():
    first = images(scene())
    assert np.array_equal(first, images(scene()))
    for change in (
        {"seed": 1}, {"noise_std": 2.0}, {"contrast": 2.0}, {"clutter": 0.5}, {"view_azimuth_deg": 60.0},
        {"first_frame": 1}, {"path": "circle"}, {"person_px": 60.0}, {"rate_hz": 60.0},
    ):  # fmt: skip
        assert not np.array_equal(first, images(scene(**change))), change


def test_cached_images_are_identical_and_not_rendered_again(tmp_path, monkeypatch):
    first = images(scene(cache=str(tmp_path)))
    assert np.array_equal(first, images(scene()))
    (file,) = tmp_path.rglob("*.npz")
    assert not list(tmp_path.rglob("*.part"))

    def fail(*_):
        raise AssertionError("rendered again")

    monkeypatch.setattr(synthetic.render, "render", fail)
    assert np.array_equal(first, images(scene(cache=str(tmp_path))))
    for change in ({"seed": 1}, {"noise_std": 3.0}, {"first_frame": 1}, {"height": 121}):
        with pytest.raises(AssertionError, match="rendered again"):
            images(scene(cache=str(tmp_path), **change))
    monkeypatch.undo()

    monkeypatch.setattr(synthetic, "code_digest", lambda *modules: "of another renderer")
    images(scene(cache=str(tmp_path)))
    assert len(list(tmp_path.rglob("*.npz"))) == 2
    assert file.exists()


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "text", "other"])
def test_a_damaged_cache_is_rendered_again_with_a_warning(tmp_path, damage):
    first = images(scene(cache=str(tmp_path)))
    (file,) = tmp_path.rglob("*.npz")
    content = file.read_bytes()
    middle = len(content) // 2
    if damage == "other":
        np.savez(file, images=first[:1])
    else:
        flipped = content[:middle] + bytes([content[middle] ^ 255]) + content[middle + 1 :]
        file.write_bytes({"cut": content[:middle], "empty": b"", "text": b"images", "flip": flipped}[damage])
    with pytest.warns(UserWarning, match="damaged"):
        repeated = images(scene(cache=str(tmp_path)))
    assert np.array_equal(first, repeated)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(first, images(scene(cache=str(tmp_path))))


def test_a_motion_of_a_library_is_rendered(tmp_path):
    motions = builtin_motions(2, seed=3)
    write_library(tmp_path / "lib.h5", motions)
    dataset = scene(motion=f"{tmp_path / 'lib.h5'}:{motions[1].name}", rate_hz=60.0)
    assert np.array_equal(dataset.info.initial_pose, motions[1].poses[0])
    assert dataset.info.shape == motions[1].shape
    with pytest.raises(InputError, match=r"no motion 'unknown', expected one of walker_00_straight, "):
        _ = scene(motion=f"{tmp_path / 'lib.h5'}:unknown").info


def test_a_camera_of_a_file_is_used_if_it_shows_the_person(tmp_path):
    template = """
[wide]
size = [200, 150]
matrix = [[200.0, 0.0, 99.5], [0.0, 200.0, 74.5], [0.0, 0.0, 1.0]]
distortions = [-0.1, 0.0, 0.0, 0.0]
rotation = [1.5707963267948966, 0.0, 0.0]
translation = [0.0, 1.0, {depth}]
"""
    file = tmp_path / "camera.toml"
    file.write_text(template.format(depth=4.0))
    dataset = scene(calibration_file=str(file), noise_std=0.0, clutter=0.0)
    image = next(dataset.frames()).views[0].image
    assert image.shape == (150, 200)
    assert (image != 125).any()
    file.write_text(template.format(depth=-4.0))
    with pytest.raises(InputError, match="'wide' never sees the person"):
        _ = scene(calibration_file=str(file)).info


def test_a_camera_of_a_file_without_an_image_size_is_refused(tmp_path):
    file = tmp_path / "camera.yml"
    file.write_text("{K: [[200, 0, 99.5], [0, 200, 74.5], [0, 0, 1]], D: [0, 0, 0, 0], R: [0, 0, 0], T: [0, 0, 0]}")
    with pytest.raises(InputError, match=r"camera \[camera\] has no image size; add image_width, image_height"):
        _ = scene(calibration_file=str(file)).info


def test_a_cache_that_cannot_be_written_is_reported_once(tmp_path, caplog):
    (tmp_path / "file").touch()
    for _ in range(2):
        assert np.array_equal(images(scene(cache=str(tmp_path / "file"))), images(scene()))
    (message,) = caplog.messages
    assert message.startswith(f"{tmp_path}/file/scenes/")
    assert "cannot be written: Not a directory; the run continues" in message


def test_keypoints_are_the_true_joints_with_noise_and_gaps():
    dataset = Synthetic(n_frames=40, width=160, height=120, person_px=60.0, focal_px=160.0, keypoint_sigma_px=2.0)
    frames = list(dataset.frames())
    keypoints = np.array([frame.views[0].keypoints for frame in frames])
    errors = keypoints[:, :, :2] - np.array([dataset.true_camera.project(frame.truth.joints) for frame in frames])
    detected = np.isfinite(keypoints).all(axis=2)
    # standard errors: 0.012 of the fraction of 600 joints, and 0.043 px of the deviation of 1080 numbers
    assert detected.mean() == pytest.approx(0.9, abs=0.04)
    assert errors[detected].std() == pytest.approx(2.0, abs=0.15)
    assert np.all(keypoints[detected, 2] == 1.0)
