"""Folders in the format of HumanEva: videos, .cal, .ofs, C3D files of Plug-in Gait and .mp, of a person who moves."""

import cv2
import numpy as np
from view_scenes import swinging

from workbench.body.kinematics import forward, joints
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.motion.formats.c3d import write_c3d
from workbench.motion.formats.humaneva import _MARKERS as MARKERS

SKELETON = person_skeleton(from_height(1.75))
CAPTURE_HZ, N_ROWS, SIZE = 120.0, 120, (160, 120)
OFFSETS = {"C1": (3.0, 10.0, 2.0), "C2": (2.0, 9.3, 2.0004), "C3": (5.0, 12.1, 1.9996), "BW1": (4.0, 11.0, 2.0)}
"""Image, captured row and rows per image of each camera's .ofs file."""
RADII_MM = (46.0, 42.0)
GAP = (31, "LTOE")
"""A captured row, from 0, without this marker."""
_PLACES = {"C1": (3.5, 0.5, 1.4), "C2": (-0.5, 3.5, 1.5), "C3": (-3.0, -1.5, 1.3), "BW1": (2.0, 3.0, 1.2)}


def cameras():
    """Return the cameras by name, with distortion."""
    plain = {name: plain_camera(*SIZE, 150.0, place, (0.4, 0.0, 0.95), name=name) for name, place in _PLACES.items()}
    lens = np.array([-0.1, 0.02, 0.001, -0.002, 0.0])
    return {name: type(each)(**{**vars(each), "distortion": lens}) for name, each in plain.items()}


def poses():
    """Return the person's poses (F, P) in the captured rows."""
    return swinging(SKELETON, N_ROWS, CAPTURE_HZ)[1]


def captured_points(all_poses=None):
    """Return points of Plug-in Gait by name (F, 3), m: joint centres, points on the segments' axes, and 39 markers."""
    all_poses = poses() if all_poses is None else all_poses
    frames, places = forward(SKELETON, all_poses).rotations, joints(SKELETON, all_poses)

    def joint(name):
        return places[:, JOINT_NAMES.index(name)]

    def segment(name, origin, turned, upper=None):
        """Return the points of a segment whose axis z leads to a joint, or is that of a joint's frame."""
        axes = frames[:, JOINT_NAMES.index(turned)]
        z = axes[:, :, 2] if upper is None else joint(upper) - joint(origin)
        length = np.linalg.norm(z, axis=1, keepdims=True)
        z = z / length
        y = np.cross(z, axes[:, :, 0])
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        ends = {"O": 0.0 * z, "A": 0.1 * np.cross(y, z), "L": 0.1 * y, "P": (0.1 if upper is None else length) * z}
        return {f"{name}{end}": joint(origin) + offset for end, offset in ends.items()}

    points = {"TRXO": joint("neck"), **segment("PEL", "pelvis", "pelvis"), **segment("HED", "head_centre", "neck")}
    for name, side in (("left", "L"), ("right", "R")):
        points |= segment(f"{side}FE", f"{name}_knee", f"{name}_hip", f"{name}_hip")
        points |= segment(f"{side}TI", f"{name}_ankle", f"{name}_knee", f"{name}_knee")
        points |= segment(f"{side}HU", f"{name}_elbow", f"{name}_shoulder", f"{name}_shoulder")
        points |= segment(f"{side}RA", f"{name}_wrist", f"{name}_elbow", f"{name}_elbow")
        points[f"{side}CLO"] = joint(f"{name}_shoulder")
    rng = np.random.default_rng(0)
    for k, marker in enumerate(MARKERS):
        points[marker] = places[:, k % len(JOINT_NAMES)] + rng.normal(0.0, 0.05, 3)
    return points


def write(folder, subject="S1", trial="Walking_1", n_images=30, gap=GAP, offsets=None, renamed=None, level=8):
    """Write the folder of a subject with one trial and return its points by name, m, with the gap.

    Image k, from 0, of a camera has the grey level `level` times k. renamed : labels of points by their usual names.
    """
    root = folder / subject
    for name in ("Image_Data", "Calibration_Data", "Sync_Data", "Mocap_Data"):
        (root / name).mkdir(parents=True, exist_ok=True)
    for name, camera in cameras().items():
        lens = [*camera.matrix[[0, 1], [0, 1]], *camera.matrix[:2, 2], 0.0, *camera.distortion]
        values = [*lens, *camera.rotation.ravel(), *(1000.0 * camera.translation)]
        (root / "Calibration_Data" / f"{name}.cal").write_text("\n".join(map(repr, map(float, values))))
        path = root / "Image_Data" / f"{trial}_({name}).avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"XVID"), 60.0, SIZE)
        for k in range(n_images):
            writer.write(np.full((SIZE[1], SIZE[0], 3), level * k, np.uint8))
        writer.release()
    for name, values in (OFFSETS if offsets is None else offsets).items():
        (root / "Sync_Data" / f"{trial}_({name}).ofs").write_text("\n".join(map(str, values)) + "\n")
    points = captured_points()
    if gap is not None:
        points[gap[1]] = np.where(np.arange(N_ROWS)[:, None] == gap[0], np.nan, points[gap[1]])
    points = {name: np.float32(1000.0 * each).astype(float) / 1000.0 for name, each in points.items()}  # as in the file
    _capture(root / "Mocap_Data" / f"{trial}.c3d", points, renamed or {})
    _capture(root / "Mocap_Data" / "Static.c3d", captured_points(np.repeat(poses()[:1], 3, axis=0)), renamed or {})
    widths = "".join(f"${side}ShoulderOffset = {mm}\n" for side, mm in zip("LR", RADII_MM, strict=True))
    (root / "Mocap_Data" / f"{subject}.mp").write_text(f"$LKneeWidth = 105\n{widths}$HeadOffset = 12.5\n")
    return points


def _capture(path, points, renamed):
    names = [f"person:{renamed.get(name, name)}" for name in points]
    write_c3d(path, names, np.stack(list(points.values()), axis=1), CAPTURE_HZ, "mm", 1000.0)
