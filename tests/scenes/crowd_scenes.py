"""Detections of several people in calibrated cameras: in random order, with missing people and swapped sides."""

from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera, plain_camera
from workbench.cameras.triangulation import triangulate_normalized
from workbench.detections.association.detector_view import detector_view
from workbench.detections.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.detections.readers.people import People

RATE_HZ = 30.0
CAMERAS = {
    name: plain_camera(1280, 960, 1000.0, place, (0.0, 0.0, 0.9), name=name)
    for name, place in {"front": (4.5, 0.3, 1.5), "left": (0.5, 4.5, 1.4), "back": (-3.5, -3.0, 1.6)}.items()
}


@dataclass(frozen=True, eq=False)
class Crowd:
    """Detections and their true identities.

    people: by camera. owners: by camera and frame, the person (n,) of each detection. swapped: by camera and frame,
    whether left and right are swapped in the arms and legs of each detection, (n, 2).
    """

    cameras: dict[str, Camera]
    people: dict[str, People]
    owners: dict[str, list[np.ndarray]]
    swapped: dict[str, list[np.ndarray]]


def walkers(paths, n_frames=30, rate_hz=RATE_HZ):
    """Return joints (T, J, 3), m, of people who walk on straight paths [start (2,), velocity (2,)], m and m/s."""
    times = np.arange(n_frames) / rate_hz
    all_joints = []
    for number, (start, velocity) in enumerate(paths):
        skeleton = person(from_height(1.65 + 0.1 * number)).skeleton
        poses = np.zeros((n_frames, 25))
        poses[:, :2] = np.array(start) + times[:, None] * np.array(velocity)
        poses[:, 2], poses[:, 3] = 0.9, np.arctan2(velocity[1], velocity[0])
        for part, sign in (("left_hip_flexion", 1), ("right_hip_flexion", -1), ("left_shoulder_flexion", -1)):
            poses[:, skeleton.dof(part)] = sign * 0.5 * np.sin(2.0 * np.pi * 0.9 * times + number)
        all_joints.append(joints(skeleton, poses))
    return all_joints


def projections(cameras, places, rng, sigma_px=3.0):
    """Return detections (T, J, 3), [u, v, confidence], of people's joints (T, J, 3), by camera and person.

    They are NaN outside the image and for the pelvis and the neck, which detectors do not report.
    """
    detections = {name: [] for name in cameras}
    for name, camera in cameras.items():
        for person_joints in places:
            shape = person_joints.shape[:2]
            pixels = camera.project(person_joints) + sigma_px * rng.standard_normal((*shape, 2))
            rows = np.concatenate([pixels, rng.uniform(0.4, 0.9, (*shape, 1))], axis=2)
            rows[:, [JOINT_NAMES.index("pelvis"), JOINT_NAMES.index("neck")]] = np.nan
            rows[~_inside(camera, rows)] = np.nan
            detections[name].append(rows)
    return detections


def _inside(camera, rows):
    return ((rows[..., :2] > 0.0) & (rows[..., :2] < [camera.width, camera.height])).all(axis=-1)


def crowd(cameras, detections, rng, missing=0.1, hidden=0.5, lost_joints=0.03, swapped=0.0):
    """Merge the detections of all people, by camera and person (T, J, 3), in random order.

    missing: fraction of frames without a person in a view, half of them in blocks of ten frames. hidden: the same while
    another person occludes this one. lost_joints: fraction of missing joints. swapped: fraction of blocks of five
    frames in which the arms, or the legs, have left and right swapped.
    """
    people, owners, swaps = {}, {}, {}
    for name in cameras:
        everyone = [rows.copy() for rows in detections[name]]
        n_frames = len(everyone[0])
        exchanges = rng.random((len(everyone), 2, n_frames // 5 + 1)) < swapped
        exchanges = np.repeat(exchanges, 5, axis=2)[:, :, :n_frames]
        absent = _absent(everyone, rng, missing, hidden)
        for rows, parts, missing_frames in zip(everyone, exchanges, absent, strict=True):
            for names, frames in zip((ARMS, LEGS), parts, strict=True):
                rows[frames] = rows[frames][:, exchanged(*names)]
            rows[rng.random(rows.shape[:2]) < lost_joints] = np.nan
            rows[missing_frames] = np.nan
        joints_of, owners[name], swaps[name] = [], [], []
        for t in range(n_frames):
            present = [k for k in range(len(everyone)) if np.isfinite(everyone[k][t, :, 0]).sum() > 3]
            order = rng.permutation(present).astype(int)
            joints_of.append(np.array([everyone[k][t] for k in order]).reshape(-1, len(JOINT_NAMES), 3))
            owners[name].append(order)
            swaps[name].append(exchanges[order, :, t])
        people[name] = People(name, "COCO_17", np.arange(n_frames), tuple(joints_of))
    return Crowd(dict(cameras), people, owners, swaps)


def _absent(everyone, rng, missing, hidden):
    """Return when people are not detected, (K, T): at random, and while a larger person occludes them."""
    n_frames, absent = len(everyone[0]), []
    for rows in everyone:
        single = rng.random(n_frames) < 0.5 * missing
        long = np.repeat(rng.random(n_frames // 10 + 1) < 0.5 * missing, 10)[:n_frames]
        behind = np.zeros(n_frames, dtype=bool)
        for other in everyone:
            if other is not rows:
                (low, high), (low_2, high_2) = _box(rows), _box(other)
                common = np.clip(np.minimum(high, high_2) - np.maximum(low, low_2), 0.0, None).prod(axis=1)
                larger = (high_2 - low_2)[:, 1] > (high - low)[:, 1]
                behind |= larger & (common > 0.5 * (high - low).prod(axis=1))
        absent.append(single | long | (behind & (np.repeat(rng.random(n_frames // 5 + 1), 5)[:n_frames] < hidden)))
    return absent


def _box(rows):
    pixels = np.nan_to_num(rows[..., :2], nan=np.inf).min(axis=1), np.nan_to_num(rows[..., :2], nan=-np.inf).max(axis=1)
    return np.where(np.isfinite(pixels), pixels, 0.0)


def copies(cameras, own, motions, rate_hz):
    """Add copies of a person's detections, (T, J, 3) by camera, under rigid motions of the world.

    Joints are triangulated in every frame, moved and projected; the recorded residuals of their frame are added.
    motions: (rotation about the vertical, rad; shift at the first frame (2,), m; velocity (2,), m/s; frames by which
    the poses are shifted in time: they run to the last frame and back again).
    """
    people = {name: People(name, "COCO_17", np.arange(len(rows)), tuple(rows[:, None])) for name, rows in own.items()}
    views = [detector_view(people[name], camera) for name, camera in cameras.items()]
    pairs = zip(views, cameras, strict=True)
    places = np.array([[view.detection(rows).places for rows in own[name]] for view, name in pairs])
    world = triangulate_normalized(list(cameras.values()), places)
    middle = np.nanmean(world, axis=(0, 1))
    detections = {name: [rows] for name, rows in own.items()}
    for turn, shift, velocity, delay in motions:
        time = abs((np.arange(len(world)) + delay) % (2 * len(world) - 2) - len(world) + 1)  # forwards and backwards
        spin = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        path = np.array(shift) + np.arange(len(world))[:, None] / rate_hz * np.array(velocity)
        moved = (world[time] - middle) @ spin.T + middle
        moved[..., :2] += path[:, None]
        for name, camera in cameras.items():
            rows = own[name][time].copy()
            rows[..., :2] += camera.project(moved) - camera.project(world[time])
            rows[~_inside(camera, rows)] = np.nan
            detections[name].append(rows)
    return detections


def identities(scene, track):
    """Return the person that a track shows, (V, T), −1 for none, and the people in every frame and view, (T, V, K)."""
    n_people = 1 + max(int(order.max()) for orders in scene.owners.values() for order in orders if len(order))
    names, n_frames = list(scene.cameras), len(track.frames)
    owner, present = np.full((len(names), n_frames), -1), np.zeros((n_frames, len(names), n_people), dtype=bool)
    for view, name in enumerate(names):
        for t in range(n_frames):
            order, rows = scene.owners[name][t], scene.people[name].joints[t]
            present[t, view, order] = True
            same = [np.nansum(abs(_unsided(detection) - _unsided(track.joints[view, t]))) < 1e-6 for detection in rows]
            if np.isfinite(track.joints[view, t, :, 0]).any():
                owner[view, t] = order[int(np.argmax(same))]
    return owner, present


def _unsided(rows):
    """Return a person's detected pixels, sorted so that swapped sides make no difference."""
    return np.sort(np.nan_to_num(rows[:, 0]))
