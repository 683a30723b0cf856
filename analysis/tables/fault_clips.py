"""Clips of people before cameras, as files that `workbench track` reads: videos, detections and a calibration.

Generated people have the errors of a detector that were measured: definitions of joints that are constant over a clip,
noise of 1.5 % of the person's height that lasts for several frames, and world landmarks whose depths are too small and
uncertain. The balancing man has detections by OpenPose. Images show a background at rest and a figure at the joints.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from analysis.tables.cameras import correlated
from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import Shape, from_height
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.body.stature import LIMBS, usual_height
from workbench.cameras.camera import Camera, plain_camera
from workbench.cameras.camera_file import load_cameras
from workbench.cameras.triangulation import triangulate
from workbench.detections.association.target_selection import MOVING, select_target
from workbench.detections.detector.detection_files import LAYOUT
from workbench.detections.readers.formats import LAYOUTS, NUMBER_KEY, REGION_KEY, WORLD_KEY
from workbench.detections.readers.people import SourceImages, read_people
from workbench.inference.least_squares.video.detector_errors import offset_std
from workbench.likelihoods.keypoints import SIGMA_HEIGHTS
from workbench.motion.synthetic.gait import ANKLE_HEIGHT as ANKLE_OVER_CALF
from workbench.motion.synthetic.gait import average_subject, subjects, walker
from workbench.motion.synthetic.run_gait import average_runner, runner
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.rng import stream

RATE_HZ, DURATION_S = 25.0, 2.8
SIZE = (960, 540)
ONE, SEVERAL, NO_CALIBRATION = "one camera", "several cameras", "no calibration"
SETTINGS = (NO_CALIBRATION, ONE, SEVERAL)
_CONFIDENCE = 0.9
_LANDMARK_STD_M, _LANDMARK_DEPTH_STD_M, _LANDMARK_DEPTH = 0.02, 0.055, 0.65
"""Standard deviations of a world landmark across and along the line of sight, and how much of a depth landmarks show:
the depth of a bone, of two joints, has one of 0.08 m and is 20 to 50 % too small (`landmark_depths`), and directions of
a torso and of knees have 10 to 15 degrees (`landmark_agreement`)."""
DEFINITION = 1.0 / np.sqrt(2.0)
"""Factor of `offset_std`, which is for a joint and a reference whose definitions differ independently."""
_AVERAGE_M = 1.7
_BALANCE = ("pose2sim_balance", 1.69, 60.0, 0.5)
"""Folder, height of the man, rate of the frames, and scale of the images."""
_OPENPOSE = "BODY_25B"
_NECK, _HEAD = JOINT_NAMES.index("neck"), JOINT_NAMES.index("head_centre")


@dataclass(frozen=True, eq=False)
class Clip:
    """What is known of a filmed person, which a fault may change, and the truth.

    cameras : (V), as in the calibration file. keypoints : (V, F, J, 3), [u px, v px, confidence], NaN without.
    landmarks : (V, F, J, 3), m, see `View`; None without. other : keypoints and landmarks (V, F, J, 6) of a second
    person, who is not in the files. people : other people in the files, by (V, F, J, 6). images : (F,) numbers of the
    clip's undisturbed images that the files' images show. times : (F,) numbers of the undisturbed frames that the
    files' frames are meant to show. rate_hz : in the files. truth : (F', J, 3), m, in the undisturbed frames.
    true_cameras : of the truth. layout : of the detector.
    rig : cameras of which one is used.
    """

    cameras: Sequence[Camera]
    keypoints: FloatArray
    landmarks: FloatArray | None
    height_m: float
    rate_hz: float
    truth: FloatArray
    true_rate_hz: float
    true_cameras: Sequence[Camera]
    images: IntArray
    times: IntArray
    other: FloatArray
    people: Sequence[FloatArray] = ()
    layout: str = LAYOUT
    rig: Sequence[Camera] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the first camera's images, px."""
        return self.true_cameras[0].width, self.true_cameras[0].height

    @property
    def heights_px(self) -> FloatArray:
        """Median height of the person in the images of each camera, (V,), px."""
        return np.nanmedian(
            np.nanmax(self.keypoints[..., 1], axis=2) - np.nanmin(self.keypoints[..., 1], axis=2), axis=1
        )

    def of_setting(self, setting: str) -> "Clip":
        """Return the clip with the first camera only, unless there are several."""
        if setting == SEVERAL:
            return self
        landmarks = None if self.landmarks is None else self.landmarks[:1]
        return replace(
            self, cameras=self.cameras[:1], keypoints=self.keypoints[:1], landmarks=landmarks,
            true_cameras=self.true_cameras[:1], other=self.other[:1], rig=self.cameras,
        )  # fmt: skip


def rig(n: int, distance_m: float = 5.5, azimuth_deg: float = -95.0) -> tuple[Camera, ...]:
    """Return different cameras that face (0, 0, 0.9) from different sides, the first from this distance."""
    cameras = []
    for k, (turn_deg, focal_px, height_m) in enumerate(
        [(0.0, 675.0, 1.4), (70.0, 750.0, 1.9), (150.0, 615.0, 1.1)][:n]
    ):
        angle, away_m = np.radians(azimuth_deg + turn_deg), distance_m * focal_px / 675.0
        place = (away_m * float(np.cos(angle)), away_m * float(np.sin(angle)), height_m)
        cameras.append(plain_camera(*SIZE, focal_px, place, (0.0, 0.0, 0.9), f"cam{k}"))
    return tuple(cameras)


def generated(shape: Shape, poses: FloatArray, seed: int, cameras: Sequence[Camera] | None = None) -> Clip:
    """Return the clip of a generated person with poses (F, P) at RATE_HZ, whose middle is moved to the origin."""
    rng, cameras = stream(seed, "clip"), rig(3) if cameras is None else cameras
    skeleton = person(shape).skeleton
    poses = poses.copy()
    poses[:, :2] -= 0.5 * (poses[:, :2].min(axis=0) + poses[:, :2].max(axis=0))
    frames = forward(skeleton, poses)
    definitions = DEFINITION * offset_std(skeleton)[:, None] * rng.standard_normal((len(skeleton.names), 3))
    turned = frames.rotations[:, skeleton.parents.clip(min=0)]
    detected = frames.positions + (turned @ definitions[:, :, None])[..., 0]
    order = [skeleton.joint(name) for name in JOINT_NAMES]
    observed = observations(cameras, detected[:, order], rng)
    height_m = usual_height({limb: getattr(shape, limb) for limb in LIMBS})
    numbers, truth = np.arange(len(poses)), frames.positions[:, order]
    return Clip(
        cameras, observed[..., :3], observed[..., 3:], height_m, RATE_HZ, truth, RATE_HZ, cameras, numbers, numbers,
        observations(cameras, _other_person(truth), rng),
    )  # fmt: skip


def observations(cameras: Sequence[Camera], places: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return keypoints and landmarks (V, F, J, 6) of joints (F, J, 3) with a detector's noise."""
    views = []
    for camera in cameras:
        pixels = camera.project(places)
        height_px = float(np.median(np.ptp(pixels[..., 1], axis=1)))
        noise = SIGMA_HEIGHTS * height_px * correlated(rng, pixels.shape)
        directions = places.mean(axis=1) - camera.position
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        axes = np.array([camera.viewing_axes(direction) for direction in directions])
        landmarks = (places - places[:, :1]) @ axes.swapaxes(1, 2)
        landmarks *= (
            _AVERAGE_M / float(np.median(np.ptp(places[..., 2], axis=1)) * 1.1) * np.array([1.0, 1.0, _LANDMARK_DEPTH])
        )
        deviations = np.array([_LANDMARK_STD_M, _LANDMARK_STD_M, _LANDMARK_DEPTH_STD_M])
        landmarks += deviations * correlated(rng, landmarks.shape)
        views.append(np.concatenate([pixels + noise, np.full((*pixels.shape[:2], 1), _CONFIDENCE), landmarks], axis=2))
    return np.array(views)


def _other_person(places: FloatArray) -> FloatArray:
    """Return the joints (F, J, 3) of a smaller person who does the reverse of a person's motion a metre away."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(0.88 * places[::-1] @ turn.T + [0.5, 0.9, 0.0])


def walk(seed: int, path: str = "straight", heading: float = 0.3, slow: float = 1.0, **lengths: float) -> Clip:
    """Return the clip of a generated walker. lengths : of limbs, m. slow : factor of the rate of strides."""
    subject = subjects(1, np.random.default_rng(100 + seed))[0]
    subject = replace(subject, shape=replace(subject.shape, **lengths), stride_hz=slow * subject.stride_hz)
    poses = turned(walker(subject, DURATION_S, RATE_HZ, path).poses, heading)
    return generated(subject.shape, poses, seed)


def walk_of_height(height_m: float, seed: int) -> Clip:
    """Return the clip of a walker of average proportions and of a height."""
    subject = replace(average_subject(), shape=from_height(height_m))
    return generated(subject.shape, turned(walker(subject, DURATION_S, RATE_HZ).poses, 0.2), seed)


def run(seed: int) -> Clip:
    """Return the clip of a runner, whom cameras further away see for two seconds."""
    subject = average_runner()
    return generated(subject.shape, turned(runner(subject, 2.0, RATE_HZ).poses, 0.1), seed, rig(3, 8.0))


def turned(poses: FloatArray, heading: float) -> FloatArray:
    """Return poses (F, P) turned about the vertical by an angle, rad."""
    c, s = np.cos(heading), np.sin(heading)
    poses = poses.copy()
    poses[:, :2] = poses[:, :2] @ np.array([[c, s], [-s, c]])
    poses[:, POSE_NAMES.index("root_heading")] += heading
    return poses


def exercise(seed: int, heading: float, height_m: float = 1.72, **angles: Sequence[float]) -> Clip:
    """Return the clip of a person on both feet at rest, whose angles, rad, go from the first value to the second and
    back in 2.5 s. Angles without a side are those of both."""
    shape, times_s = from_height(height_m), np.arange(int(DURATION_S * RATE_HZ)) / RATE_HZ
    phase = 0.5 - 0.5 * np.cos(2.0 * np.pi * times_s / 2.5)
    poses = np.zeros((len(times_s), len(POSE_NAMES)))
    for name, (first, last) in angles.items():
        for column in [name] if name in POSE_NAMES else [f"left_{name}", f"right_{name}"]:
            poses[:, POSE_NAMES.index(column)] = first + (last - first) * phase
    ankles = joints(person(shape).skeleton, poses)[
        :, [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")]
    ]
    poses[:, :2] -= ankles[..., :2].mean(axis=1)
    poses[:, 2] += ANKLE_OVER_CALF * shape.calf - ankles[..., 2].min(axis=1)
    return generated(shape, turned(poses, heading), seed)


MAN = "balancing man"
SUBJECTS: Mapping[str, str] = {
    "tall walker": "a generated person walks straight by",
    "small walker": "another one walks along a circle",
    MAN: "a recorded man on a beam, without landmarks",
}


@cache
def subject(name: str, data: Path | None) -> Clip:
    """Return the clip of a subject before several cameras."""
    match name:
        case "tall walker":
            return walk_of_height(1.84, 11)
        case "small walker":
            return walk(5, "circle", heading=0.9)
    assert data is not None
    return balancing_man(data)


def balancing_man(data: Path) -> Clip:
    """Return the clip of the balancing man with four cameras and every other frame."""
    (folder, height_m, rate_hz, scale) = _BALANCE
    cameras = load_cameras(data / folder / "Calib_qualisys.toml")
    paths = {camera.name: data / folder / "openpose" / f"{camera.name.replace('_', '')}_json" for camera in cameras}
    people = read_people(paths, {name: SourceImages() for name in paths})
    target = select_target(people, {camera.name: camera for camera in cameras}, rate_hz, MOVING)
    keypoints = target.joints[:, ::2, :, :3].copy()
    keypoints[..., :2] = (keypoints[..., :2] + 0.5) * scale - 0.5
    small = [camera.scaled(scale) for camera in cameras]
    # the first view is that of balance_1cam
    order = [3, 0, 1, 2]
    small, keypoints = [small[v] for v in order], keypoints[order]
    places = triangulate(small, keypoints[..., :2])
    places[:, 0] = 0.5 * (places[:, JOINT_NAMES.index("left_hip")] + places[:, JOINT_NAMES.index("right_hip")])
    numbers = np.arange(len(places))
    other = observations(small, _beside(places), stream(0, "other"))
    return Clip(
        small, keypoints, None, height_m, 0.5 * rate_hz, places, 0.5 * rate_hz, small, numbers, numbers, other,
        layout=_OPENPOSE,
    )  # fmt: skip


def _beside(places: FloatArray) -> FloatArray:
    """Return the joints (F, J, 3) of a second person near a person."""
    feet = places[..., 2].min()
    middle = np.array([*np.nanmean(places[:, 0, :2], axis=0), feet])
    return _other_person(places - middle) + middle


def write(clip: Clip, folder: Path, setting: str) -> dict[str, object]:
    """Write the files of a clip into a folder and return the keys of `experiment=video` that use them."""
    sources, detections = {}, {}
    for v, camera in enumerate(clip.cameras):
        sources[camera.name] = str(folder / f"{camera.name}.mp4")
        _write_video(Path(sources[camera.name]), clip, v)
        detections[camera.name] = str(_write_detections(folder / f"{camera.name}_keypoints", clip, v))
    keys: dict[str, object] = {"body.height_m": clip.height_m}
    if setting == SEVERAL:
        keys |= {"dataset.sources": sources, "dataset.keypoints": detections}
    else:
        (source,), (keypoints,) = sources.values(), detections.values()
        keys |= {"dataset.source": source, "dataset.keypoints": keypoints, "dataset.height_m": clip.height_m}
    if setting != NO_CALIBRATION:
        _write_calibration(folder / "rig.toml", clip.cameras)
        keys["dataset.calibration_file"] = str(folder / "rig.toml")
    return keys


def _write_calibration(path: Path, cameras: Sequence[Camera]) -> None:
    """Write cameras with their rotations as matrices, so that faulty ones remain what they are."""
    tables = {
        camera.name: {
            "size": [camera.width, camera.height], "matrix": camera.matrix.tolist(),
            "distortions": camera.distortion.tolist(), "rotation": camera.rotation.tolist(),
            "translation": camera.translation.tolist(),
        } for camera in cameras
    }  # fmt: skip
    lines = [f"[{name}]\n" + "".join(f"{key} = {value}\n" for key, value in table.items())
             for name, table in tables.items()]  # fmt: skip
    path.write_text("\n".join(lines), encoding="ascii")


def _write_video(path: Path, clip: Clip, view: int) -> None:
    """Write a view's images: a background at rest, a figure at the true joints, and noise."""
    camera = clip.true_cameras[view]
    size, rng = (camera.width, camera.height), np.random.default_rng(view)
    coarse = rng.integers(30, 220, (size[1] // 16, size[0] // 16, 3), dtype=np.uint8)
    background = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC).clip(0, 240)
    noise = rng.integers(0, 8, background.shape, dtype=np.uint8)
    pixels = camera.project(clip.truth)
    bones = person(from_height(_AVERAGE_M)).skeleton.bones
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), clip.rate_hz, size)
    for number in clip.images:
        image = background + np.roll(noise, 41 * int(number), axis=1)
        for a, b in bones:
            ends = pixels[number, [a, b]]
            if np.isfinite(ends).all():
                cv2.line(image, *np.rint(ends).astype(int).tolist(), (60, 40, 30), size[1] // 40)
        writer.write(image)
    writer.release()


def _write_detections(folder: Path, clip: Clip, view: int) -> Path:
    """Write the people detected in a view, one file a frame in the form of `workbench detect` or of OpenPose."""
    folder.mkdir()
    target = clip.keypoints[view]
    if clip.landmarks is not None:
        target = np.concatenate([target, clip.landmarks[view]], axis=2)
    everyone = [target, *(each[view] for each in clip.people)]
    for t in range(len(target)):
        people = [_as_json(rows[t], number, clip.layout) for number, rows in enumerate(everyone)
                  if np.isfinite(rows[t, :, 0]).any()]  # fmt: skip
        path = folder / f"{clip.cameras[view].name}_{t:012d}_keypoints.json"
        path.write_text(json.dumps({"version": 1.3, "people": people}), encoding="ascii")
    return folder


def _as_json(rows: FloatArray, number: int, layout: str) -> dict[str, object]:
    """Return a person with joints (J, 3) or (J, 6) in the points of a layout."""
    by_name = dict(zip(JOINT_NAMES, rows, strict=True))
    by_name["head_top"] = np.concatenate([2.0 * rows[_HEAD, :2] - rows[_NECK, :2], rows[_HEAD, 2:]])
    by_name |= {f"{side}_ear": rows[_HEAD] for side in ("left", "right")}
    nothing = np.zeros(rows.shape[1])
    points = np.nan_to_num([by_name.get(name, nothing) for name in LAYOUTS[layout]])
    content: dict[str, object] = {
        NUMBER_KEY: [number],
        "pose_keypoints_2d": np.round(points[:, :3], 3).ravel().tolist(),
    }
    if rows.shape[1] > 3 and layout == LAYOUT:
        content |= {WORLD_KEY: np.round(points[:, 3:], 4).ravel().tolist(), REGION_KEY: [0.0, 0.0, 1.0, 0.0]}
    return content
