"""Write the files that baselines read, as seen by the cameras in their folder: `python -m analysis.baseline_inputs`.

These are a generated walker's images, joints annotated in the left camera and detected in the right one, both with
errors, and true joints.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import cv2

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera_file import load_cameras
from workbench.core.frame import Frame
from workbench.datasets.synthetic import Synthetic

FOLDER = Path(__file__).parents[1] / "recordings" / "baselines" / "inputs"


def annotations(frames: Sequence[Frame]) -> str:
    """Return the table of annotated joints, of which every fifth is occluded."""
    lines = [f"{frame.index},{name},{u},{v}" for frame in frames for name, u, v in _seen(frame)]
    return "\n".join(["frame,joint,u,v,visible", *[f"{line},{int(k % 5 > 0)}" for k, line in enumerate(lines)], ""])


def detections(frames: Sequence[Frame]) -> str:
    """Return the JSON of detected joints, one person in each frame, with different confidences."""
    people = [
        [{"name": name, "x": u, "y": v, "score": 0.5 + k / 32} for k, (name, u, v) in enumerate(_seen(frame))]
        for frame in frames
    ]
    return json.dumps([[{"keypoints": points}] for points in people])


def true_joints(frames: Sequence[Frame]) -> str:
    """Return the table of true joints, m."""
    truths = [(frame.time_s, frame.truth.joints) for frame in frames if frame.truth is not None]
    rows = [[time_s, *joints.ravel()] for time_s, joints in truths if joints is not None]
    names = ["frame", "time_s", *[f"{joint}_{axis}_m" for joint in JOINT_NAMES for axis in "xyz"]]
    lines = [",".join([str(k), *[f"{value:.4f}" for value in row]]) for k, row in enumerate(rows)]
    return "\n".join([",".join(names), *lines, ""])


def _seen(frame: Frame) -> list[tuple[str, float, float]]:
    """Return the detected joints and their pixels."""
    keypoints = frame.views[0].keypoints
    assert keypoints is not None
    rows = zip(JOINT_NAMES, keypoints.round(2).tolist(), strict=True)
    return [(name, u, v) for name, (u, v, weight) in rows if weight > 0.0]


def main() -> None:
    """Write the files."""
    frames = {}
    for camera in load_cameras(FOLDER / "cameras.toml"):
        scene = Synthetic(n_frames=7, rate_hz=10.0, noise_std=1.0, keypoint_sigma_px=1.0)
        scene.true_camera = camera
        frames[camera.name] = list(scene.frames())
        (FOLDER / camera.name).mkdir(exist_ok=True)
        for frame in frames[camera.name]:
            cv2.imwrite(str(FOLDER / camera.name / f"{frame.index}.png"), frame.views[0].image)
    texts = {
        "left.csv": annotations(frames["left"]), "right.json": detections(frames["right"]),
        "joints.csv": true_joints(frames["left"]),
    }  # fmt: skip
    for name, text in texts.items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
