"""HumanEva's virtual markers, synchronization and error, frame by frame with matrices and quaternions."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp


def turn_y(angle):
    """Return the benchmark's rotation about y, by the negative angle of the usual one."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [0, 0, 0, 1.0]])


def first_images_and_row(offsets):
    """Return the first images, from 1, and the captured row, from 1, of frame 1, and the rows per frame.

    offsets : (image, row, scale) by camera, the reference first.
    """
    (_, row, _), *_ = offsets.values()
    starts = {name: image + (row - own) / scale for name, (image, own, scale) in offsets.items()}
    scale = sum(each[2] for each in offsets.values()) / len(offsets)
    earliest = min(starts.values())
    row -= scale * (earliest - 1)
    starts = {name: start - earliest + 1 for name, start in starts.items()}
    if row < 1:
        starts, row = {name: start - (row - 1) / scale for name, start in starts.items()}, 1.0
    return {name: int(np.floor(start + 0.5)) for name, start in starts.items()}, row, scale


def markers_mm(points, row, radius, offsets):
    """Return the virtual markers (20 points by name), mm, in a row, from 0, of points (F, 3) by name, mm; None where
    one of the two rows has a gap."""
    low, high = int(np.floor(row)), int(np.ceil(row))
    if low < 0 or high >= len(points["PELO"]) or any(np.isnan(each[[low, high]]).any() for each in points.values()):
        return None

    def length(a, b):
        return 0.5 * sum(np.sqrt(((points[a][k] - points[b][k]) ** 2).sum()) for k in (low, high))

    def frame(segment, origin):
        axes = []
        for k in (low, high):
            columns = [points[f"{segment}{end}"][k] - points[f"{segment}O"][k] for end in "ALP"]
            axes.append(np.column_stack([each / np.linalg.norm(each) for each in columns]))
        matrix = np.eye(4)
        turned = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack(axes)))(row - low)
        matrix[:3, :3] = turned.as_matrix()
        matrix[:3, 3] = (1 - (row - low)) * points[origin][low] + (row - low) * points[origin][high]
        return matrix

    def at(matrix, x, y, z):
        return (matrix @ [x, y, z, 1.0])[:3]

    pelvis, trunk = frame("PEL", "PELO"), length("TRXO", "PELO")
    pelvis = pelvis @ np.block([[np.eye(3), np.array([[-50.0], [0], [0]])], [np.zeros((1, 3)), 1.0]])
    pelvis = pelvis @ turn_y(np.arctan2(radius / 2, trunk))
    head = frame("HED", "TRXO")
    found = {
        "torsoProximal": at(pelvis, 0, 0, trunk), "torsoDistal": at(pelvis, 0, 0, 0),
        "headProximal": at(head, 0, 0, 0), "headDistal": at(head, 0, 0, 316.103),
    }  # fmt: skip
    for side, offset in zip("LR", offsets, strict=True):
        thigh = frame(f"{side}FE", f"{side}FEP") @ turn_y(np.pi)
        calf = frame(f"{side}TI", f"{side}FEO") @ turn_y(np.pi)
        found |= {
            f"upper{side}LegProximal": at(thigh, 0, 0, 0),
            f"upper{side}LegDistal": at(thigh, 0, 0, length(f"{side}FEP", f"{side}FEO")),
            f"lower{side}LegProximal": at(calf, 0, 0, 0),
            f"lower{side}LegDistal": at(calf, 0, 0, length(f"{side}FEO", f"{side}TIO")),
        }
        upper, lower = length(f"{side}CLO", f"{side}HUO"), length(f"{side}HUO", f"{side}RAO")
        shoulder, elbow = frame(f"{side}HU", f"{side}CLO"), frame(f"{side}RA", f"{side}HUO")
        difference = elbow[:3, 3] - at(shoulder, 0, 0, -upper)
        shoulder = shoulder @ turn_y(-np.arctan2(offset / 2, upper))
        elbow[:3, 3] = at(shoulder, 0, 0, -upper) + difference
        elbow = elbow @ turn_y(np.arctan2(offset / 2, upper))
        found |= {
            f"upper{side}ArmProximal": at(shoulder, 0, 0, 0), f"upper{side}ArmDistal": at(shoulder, 0, 0, -upper),
            f"lower{side}ArmProximal": at(elbow, 0, 0, 0), f"lower{side}ArmDistal": at(elbow, 0, 0, -lower),
        }  # fmt: skip
    return found


PAIRS = {
    "pelvis": ("torsoDistal",), "neck": ("torsoProximal", "headProximal"), "head_centre": ("headDistal",),
    **{
        f"{name}_{joint}": tuple(end.format(side) for end in ends)
        for name, side in (("left", "L"), ("right", "R"))
        for joint, ends in {
            "hip": ("upper{}LegProximal",), "knee": ("upper{}LegDistal", "lower{}LegProximal"),
            "ankle": ("lower{}LegDistal",), "shoulder": ("upper{}ArmProximal",),
            "elbow": ("upper{}ArmDistal", "lower{}ArmProximal"), "wrist": ("lower{}ArmDistal",),
        }.items()
    },
}  # fmt: skip
"""Virtual markers of a joint."""


def error(estimate, truth):
    """Return the mean over 15 joints of the mean distance of estimated places from the markers of a joint, by name."""
    distances = []
    for joint, ends in PAIRS.items():
        distances.append(np.mean([np.linalg.norm(estimate[joint] - truth[end]) for end in ends]))
    return float(np.mean(distances))
