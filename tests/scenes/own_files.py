"""One's own files that the documents' commands name, small and made up: films, marks, cameras, points, motion."""

from dataclasses import replace

import cv2
import numpy as np
from bandai_files import write_bandai_like
from openpose_scenes import points, write
from rendered_boards import board_poses, lens, rendered
from seen_walkers import around, walked

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.points import Points
from workbench.motion.sources import find_motion

N = 6
"""Frames of films and of points."""
CORNERS, SQUARE_MM = "7x4", "50"
"""Of the boards in the films, in place of those that the documents name."""
_LAYOUT = "BODY_25B"


def write_own_files(folder):
    """Write walk.mp4 with marks.csv and joints.csv; one.mp4 and two.mp4 with their detections and board films;
    camera.toml and calibration.toml; points/; clips/ and my_walk.bvh."""
    one, two = (replace(camera.scaled(0.25), name=f"cam{k}") for k, camera in enumerate(around(2), 1))
    (folder / "calibration.toml").write_text(toml(one) + toml(two))
    (folder / "camera.toml").write_text(toml(one))
    for name, camera in {"walk": one, "one": one, "two": two}.items():
        film(folder / f"{name}.mp4", [np.full((camera.height, camera.width, 3), 90, np.uint8)] * N)
    seen = {name: camera.project(walked()[:N]) for name, camera in (("one", one), ("two", two))}
    for name, marks in seen.items():
        people = [[points(_LAYOUT, dict(zip(JOINT_NAMES, frame, strict=True)))] for frame in marks.tolist()]
        write(folder / f"{name}_json", dict(enumerate(people)))
    rows = [f"{t},{joint},{u:.2f},{v:.2f},1" for t, frame in enumerate(seen["one"])
            for joint, (u, v) in zip(JOINT_NAMES, frame, strict=True)]  # fmt: skip
    for name in ("marks", "joints"):
        (folder / f"{name}.csv").write_text("\n".join(["frame,joint,u,v,visible", *rows, ""]))
    _boards(folder)
    (folder / "points").mkdir()
    for frame in Points(n_frames=N, n_points=120).frames():
        np.savetxt(folder / "points" / f"{frame.index}.csv", frame.points, delimiter=",", header="x,y,z", comments="")
    motion = find_motion("builtin", data=None, rate_hz=30.0)
    for name in ("clips/dataset-1_walk_normal_001", "my_walk"):
        write_bandai_like(folder / f"{name}.bvh", motion)


def _boards(folder):
    left = lens("cam1")
    for number, camera in enumerate((left, replace(left, name="cam2", translation=np.array([-0.1, 0.0, 0.0]))), 1):
        film(folder / f"board{number}.mp4", [rendered(camera, *pose) for pose in board_poses(7)])


def film(path, images):
    """Write images (height, width, 3) as a video of ten a second."""
    height, width = images[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, (width, height))
    for image in images:
        video.write(image)
    video.release()


def toml(camera: Camera):
    """What Pose2Sim and Sports2D write of a camera without distortion."""
    turn = cv2.Rodrigues(camera.rotation)[0].ravel()
    return (
        f"[{camera.name}]\nsize = [{camera.width}, {camera.height}]\nmatrix = {camera.matrix.tolist()}\n"
        f"distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = {turn.tolist()}\ntranslation = {camera.translation.tolist()}\n"
    )
