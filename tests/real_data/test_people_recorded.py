"""Real detections of a man who balances before four cameras, and of him again as somebody who crosses his way."""

import numpy as np
import pytest
from crowd_scenes import copies, crowd, identities

from workbench.body.camera import load_cameras
from workbench.datasets.association.target_selection import select_target
from workbench.motion.formats.openpose import read_openpose

RATE_HZ = 60.0


@pytest.fixture(scope="module")
def recorded(data):
    """Cameras and what was found, by name."""
    folder = data / "pose2sim_balance"
    if not folder.is_dir():
        pytest.skip(f"no recordings of several cameras: {folder}")
    cameras = {camera.name: camera for camera in load_cameras(folder / "Calib_qualisys.toml")}
    people = {name: read_openpose(folder / "openpose" / f"{name.replace('_', '')}_json") for name in cameras}
    return cameras, people


def test_the_man_is_told_from_the_bystander(recorded):
    cameras, people = recorded
    found = select_target(people, cameras, RATE_HZ)
    assert found.counts == {"people": 2, "frames_unseen": 0, "swapped_sides": 0}  # two cameras see somebody sit there
    assert np.isfinite(found.joints[..., 0]).any(axis=2).all()
    bystander = select_target(people, cameras, RATE_HZ, {"cam_01": 1})
    np.testing.assert_array_equal(bystander.joints, select_target(people, cameras, RATE_HZ, {"cam_02": 1}).joints)
    heights = np.nanmax(bystander.joints[0, ..., 1], axis=1) - np.nanmin(bystander.joints[0, ..., 1], axis=1)
    assert np.ptp(heights) < 20.0  # who does not move
    assert np.isnan(bystander.joints[2:, ..., 0]).all()


@pytest.mark.parametrize(
    ("apart_m", "seed"),
    [(0.3, 0), *(pytest.param(m, s, marks=pytest.mark.slow) for s, m in enumerate((0.3, 0.5, 1.0), 1))],
)
def test_two_who_cross_are_told_apart(recorded, apart_m, seed):
    cameras, people = recorded
    rng = np.random.default_rng(seed)
    man = dict(zip(cameras, select_target(people, cameras, RATE_HZ).joints, strict=True))
    way, turn = rng.uniform(0.0, 2.0 * np.pi, 2)
    ahead, aside = np.array([np.cos(way), np.sin(way)]), np.array([-np.sin(way), np.cos(way)])
    start, velocity = apart_m * aside - ahead, 1.2 * ahead  # he is nearest 0.83 s after the first frame
    both = copies(cameras, man, [(turn, start, velocity, int(rng.integers(5, 95)))], RATE_HZ)
    made = crowd(cameras, both, rng, missing=0.1, swapped=0.02)
    for who in range(2):
        name, row = next(
            (name, int(np.flatnonzero(made.owners[name][0] == who)[0]))
            for name in cameras if who in made.owners[name][0]
        )  # fmt: skip
        found = select_target(made.people, cameras, RATE_HZ, {name: row})
        owner, there = identities(made, found)
        assert set(owner.ravel().tolist()) <= {-1, who}  # no frame of two people, none of the other one
        assert (owner == who).any(axis=0)[there[:, :, who].sum(axis=1) >= 2].mean() >= 0.95
