"""Several people before calibrated cameras, as detectors show them: in any order, some missing, sides exchanged."""

from dataclasses import dataclass

import numpy as np

from workbench.body.camera import Camera, plain_camera
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.detections import detector_view, triangulate_places
from workbench.datasets.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.motion.formats.openpose import People

RATE_HZ = 30.0
CAMERAS = {
    name: plain_camera(1280, 960, 1000.0, place, (0.0, 0.0, 0.9), name=name)
    for name, place in {"front": (4.5, 0.3, 1.5), "left": (0.5, 4.5, 1.4), "back": (-3.5, -3.0, 1.6)}.items()
}


@dataclass(frozen=True, eq=False)
class Crowd:
    """people: by camera. owners: (T,) for each camera whom each detection shows. swapped: (T,) for each camera, in what
    parts of each detection sides were exchanged, (n, 2)."""

    cameras: dict[str, Camera]
    people: dict[str, People]
    owners: dict[str, list[np.ndarray]]
    swapped: dict[str, list[np.ndarray]]


def walkers(ways, n_frames=30, rate_hz=RATE_HZ):
    """Joints (T, J, 3), m, of people who swing arms and legs on straight ways, [start (2,), velocity (2,)], m and
    m/s."""
    times = np.arange(n_frames) / rate_hz
    found = []
    for number, (start, velocity) in enumerate(ways):
        skeleton = person(from_height(1.65 + 0.1 * number)).skeleton
        poses = np.zeros((n_frames, 25))
        poses[:, :2] = np.array(start) + times[:, None] * np.array(velocity)
        poses[:, 2], poses[:, 3] = 0.9, np.arctan2(velocity[1], velocity[0])
        for part, sign in (("left_hip_flexion", 1), ("right_hip_flexion", -1), ("left_shoulder_flexion", -1)):
            poses[:, skeleton.dof(part)] = sign * 0.5 * np.sin(2.0 * np.pi * 0.9 * times + number)
        found.append(joints(skeleton, poses))
    return found


def projections(cameras, places, rng, sigma_px=3.0):
    """What cameras show of people's joints (T, J, 3): (T, J, 3) by camera and person, [u, v, confidence], NaN outside
    of the image, and for the pelvis and the neck, which no detector finds."""
    found = {}
    for name, camera in cameras.items():
        found[name] = []
        for one in places:
            pixels = camera.project(one) + sigma_px * rng.standard_normal((*one.shape[:2], 2))
            found[name].append(np.concatenate([pixels, rng.uniform(0.4, 0.9, (*one.shape[:2], 1))], axis=2))
            found[name][-1][:, [JOINT_NAMES.index("pelvis"), JOINT_NAMES.index("neck")]] = np.nan
            found[name][-1][~_inside(camera, found[name][-1])] = np.nan
    return found


def _inside(camera, rows):
    return ((rows[..., :2] > 0.0) & (rows[..., :2] < [camera.width, camera.height])).all(axis=-1)


def crowd(cameras, found, rng, missing=0.1, hidden=0.5, lost_joints=0.03, swapped=0.0):
    """Merge what is shown of everybody, by camera and person (T, J, 3), in random order.

    missing: part of the frames without somebody in a view, half of them in stretches of ten; hidden: the same while
    another is before them; lost_joints: part of the joints not found; swapped: part of the stretches of five in which
    arms, or legs, have left and right exchanged.
    """
    people, owners, swaps = {}, {}, {}
    for name in cameras:
        everybody = [one.copy() for one in found[name]]
        n_frames = len(everybody[0])
        exchanges = rng.random((len(everybody), 2, n_frames // 5 + 1)) < swapped
        exchanges = np.repeat(exchanges, 5, axis=2)[:, :, :n_frames]
        away = _away(everybody, rng, missing, hidden)
        for one, parts, gone in zip(everybody, exchanges, away, strict=True):
            for names, where in zip((ARMS, LEGS), parts, strict=True):
                one[where] = one[where][:, exchanged(*names)]
            one[rng.random(one.shape[:2]) < lost_joints] = np.nan
            one[gone] = np.nan
        joints_of, owners[name], swaps[name] = [], [], []
        for t in range(n_frames):
            there = [k for k in range(len(everybody)) if np.isfinite(everybody[k][t, :, 0]).sum() > 3]
            order = rng.permutation(there).astype(int)
            joints_of.append(np.array([everybody[k][t] for k in order]).reshape(-1, len(JOINT_NAMES), 3))
            owners[name].append(order)
            swaps[name].append(exchanges[order, :, t])
        people[name] = People(name, "COCO_17", np.arange(n_frames), tuple(joints_of))
    return Crowd(dict(cameras), people, owners, swaps)


def _away(everybody, rng, missing, hidden):
    """When everybody is not found, (K, T): at random, and while somebody larger is before them."""
    n_frames, away = len(everybody[0]), []
    for one in everybody:
        alone = rng.random(n_frames) < 0.5 * missing
        long = np.repeat(rng.random(n_frames // 10 + 1) < 0.5 * missing, 10)[:n_frames]
        behind = np.zeros(n_frames, dtype=bool)
        for other in everybody:
            if other is not one:
                (low, high), (low_2, high_2) = _box(one), _box(other)
                common = np.clip(np.minimum(high, high_2) - np.maximum(low, low_2), 0.0, None).prod(axis=1)
                larger = (high_2 - low_2)[:, 1] > (high - low)[:, 1]
                behind |= larger & (common > 0.5 * (high - low).prod(axis=1))
        away.append(alone | long | (behind & (np.repeat(rng.random(n_frames // 5 + 1), 5)[:n_frames] < hidden)))
    return away


def _box(rows):
    pixels = np.nan_to_num(rows[..., :2], nan=np.inf).min(axis=1), np.nan_to_num(rows[..., :2], nan=-np.inf).max(axis=1)
    return np.where(np.isfinite(pixels), pixels, 0.0)


def copies(cameras, own, motions, rate_hz):
    """Add to one person's detections, (T, J, 3) by camera, the same person under rigid motions of the world.

    Joints are triangulated in every frame, moved, projected, and get the distances by which the recorded detections of
    another time miss the projections of theirs. motions: (turn about the vertical, rad, shift at the first frame (2,),
    m, velocity (2,), m/s, frames by which the time of poses is shifted; they run on to the last one and back again).
    """
    people = {name: People(name, "COCO_17", np.arange(len(rows)), tuple(rows[:, None])) for name, rows in own.items()}
    eyes = [detector_view(people[name], camera) for name, camera in cameras.items()]
    places = np.array([[e.detection(one).places for one in own[name]] for e, name in zip(eyes, cameras, strict=True)])
    world, _ = triangulate_places(eyes, places)
    middle = np.nanmean(world, axis=(0, 1))
    found = {name: [rows] for name, rows in own.items()}
    for turn, shift, velocity, later in motions:
        time = abs((np.arange(len(world)) + later) % (2 * len(world) - 2) - len(world) + 1)  # to and fro
        spin = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        way = np.array(shift) + np.arange(len(world))[:, None] / rate_hz * np.array(velocity)
        moved = (world[time] - middle) @ spin.T + middle
        moved[..., :2] += way[:, None]
        for name, camera in cameras.items():
            rows = own[name][time].copy()
            rows[..., :2] += camera.project(moved) - camera.project(world[time])
            rows[~_inside(camera, rows)] = np.nan
            found[name].append(rows)
    return found


def identities(scene, followed):
    """Whom a followed person shows, (V, T), -1 for none, and who is shown in frames and views, (T, V, K)."""
    n_people = 1 + max(int(order.max()) for those in scene.owners.values() for order in those if len(order))
    names, n_frames = list(scene.cameras), len(followed.frames)
    owner, there = np.full((len(names), n_frames), -1), np.zeros((n_frames, len(names), n_people), dtype=bool)
    for view, name in enumerate(names):
        for t in range(n_frames):
            order, rows = scene.owners[name][t], scene.people[name].joints[t]
            there[t, view, order] = True
            same = [np.nansum(abs(_unsided(one) - _unsided(followed.joints[view, t]))) < 1e-6 for one in rows]
            if np.isfinite(followed.joints[view, t, :, 0]).any():
                owner[view, t] = order[int(np.argmax(same))]
    return owner, there


def _unsided(rows):
    """A person's detected pixels, whichever sides they are on."""
    return np.sort(np.nan_to_num(rows[:, 0]))
