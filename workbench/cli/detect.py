"""`workbench detect`: detect people's joints in videos."""

import os
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from workbench.detections.detector.detection_files import detect_video, has_people
from workbench.detections.detector.model_file import model_file
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible


@interruptible()
def detect(
    videos: Annotated[list[Path], Argument(metavar="VIDEO...", help="Video files or folders of images.")],
    output: Annotated[
        Path, Option("-o", "--output", metavar="DIR", help="Folder; a folder of each video's name is made in it.")
    ] = Path("detections"),
    model: Annotated[
        str, Option(metavar="full|heavy|PATH", help="BlazePose's model, downloaded once, or a model file.")
    ] = "full",
) -> None:
    """Detect the joints of every person in every frame, and write them as OpenPose's JSON files.

    The files are an input of dataset.keypoints. A detection that was
    interrupted is resumed. Rendered people are mostly not detected.

    \b
    Examples:
      workbench detect walk.mp4
      workbench detect left.mp4 right.mp4 -o keypoints --model heavy.tflite
    """
    if missing := [str(video) for video in videos if not video.exists()]:
        raise InputError(f"{', '.join(missing)}: no such video")
    names = [video.stem for video in videos]
    if len(set(names)) < len(names):
        raise InputError("expected videos of different names, as each has a folder of its name")
    path = model_file(model, Path(os.environ.get("WORKBENCH_CACHE", "~/.cache/workbench")))
    for video, name in zip(videos, names, strict=True):
        folder = output / name
        n_frames = detect_video(video, folder, path)
        if has_people(folder):
            print(f"{video}: {n_frames} frames: dataset.keypoints={folder}")
        else:
            print(f"{video}: no person is detected in {n_frames} frames")
