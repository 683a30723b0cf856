"""Association of the recorded man in four cameras, with a bystander, and with a moving copy of himself."""

import numpy as np
import pytest
from crowd_scenes import copies, crowd, identities
from openpose_scenes import people_in

from workbench.cameras.camera_file import load_cameras
from workbench.detections.association.target_selection import select_target

RATE_HZ = 60.0


@pytest.fixture(scope="module")
def recorded(data):
    """Return the cameras and the detected people, by camera name."""
    folder = data / "pose2sim_balance"
    if not folder.is_dir():
        pytest.skip(f"no recordings of several cameras: {folder}")
    cameras = {camera.name: camera for camera in load_cameras(folder / "Calib_qualisys.toml")}
    people = {name: people_in(folder / "openpose" / f"{name.replace('_', '')}_json") for name in cameras}
    return cameras, people


@pytest.fixture(scope="module")
def man(recorded):
    cameras, people = recorded
    return select_target(people, cameras, RATE_HZ)


def test_the_man_is_distinguished_from_the_bystander(recorded, man):
    cameras, people = recorded
    counts = {name: n for name, n in man.counts.items() if n}
    assert counts == {"people": 2, "frames": 100}  # two cameras show a seated bystander
    assert np.isfinite(man.joints[..., 0]).any(axis=2).all()
    bystander = select_target(people, cameras, RATE_HZ, {"cam_01": 1})
    np.testing.assert_array_equal(bystander.joints, select_target(people, cameras, RATE_HZ, {"cam_02": 1}).joints)
    heights = np.nanmax(bystander.joints[0, ..., 1], axis=1) - np.nanmin(bystander.joints[0, ..., 1], axis=1)
    assert np.ptp(heights) < 20.0  # does not move
    assert np.isnan(bystander.joints[2:, ..., 0]).all()


@pytest.mark.slow
@pytest.mark.parametrize(("distance_m", "seed"), [(0.3, 0), (1.0, 3)])
def test_two_crossing_people_are_distinguished(recorded, man, distance_m, seed):
    cameras, _ = recorded
    rng = np.random.default_rng(seed)
    direction, heading = rng.uniform(0.0, 2.0 * np.pi, 2)
    forward, left = np.array([np.cos(direction), np.sin(direction)]), np.array([-np.sin(direction), np.cos(direction)])
    start, velocity = distance_m * left - forward, 1.2 * forward  # nearest 0.83 s after the first frame
    joints = dict(zip(cameras, man.joints[..., :3], strict=True))
    both = copies(cameras, joints, [(heading, start, velocity, int(rng.integers(5, 95)))], RATE_HZ)
    scene = crowd(cameras, both, rng, missing=0.1, swapped=0.02)
    for person in range(2):
        name, row = next(
            (name, int(np.flatnonzero(scene.owners[name][0] == person)[0]))
            for name in cameras if person in scene.owners[name][0]
        )  # fmt: skip
        target = select_target(scene.people, cameras, RATE_HZ, {name: row})
        owner, visible = identities(scene, target)
        assert set(owner.ravel().tolist()) <= {-1, person}  # no frame of the other person
        assert (owner == person).any(axis=0)[visible[:, :, person].sum(axis=1) >= 2].mean() >= 0.95
