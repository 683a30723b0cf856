"""`workbench detect`: detect people's joints in videos."""

import os
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from workbench.cameras.image_changes import ImageChanges
from workbench.detections.association.target_selection import TrackedPeople, tracked_people
from workbench.detections.detector.detection_files import detect_video, has_people
from workbench.detections.detector.model_file import model_file
from workbench.detections.joint_annotations import AT_30_HZ, UNKNOWN_IMAGES, read_view
from workbench.detections.people_picture import NAME, write_people
from workbench.utils.decode import decode, frame_rate, timestamps
from workbench.utils.errors import InputError
from workbench.utils.frame_times import frame_times
from workbench.utils.parallel import single_blas_thread
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

    The files are an input of dataset.keypoints. people.png shows the people
    with their numbers. A detection that was interrupted is resumed.
    Rendered people are mostly not detected.

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
            write_people(folder / NAME, video, people := _tracked(video, folder))
            print(f"{video}: {n_frames} frames: dataset.keypoints={folder}")
            print(f"people: {len(people.numbers)}, with the numbers of dataset.person=N: {folder / NAME}")
        else:
            print(f"{video}: no person is detected in {n_frames} frames")


def _tracked(video: Path, folder: Path) -> TrackedPeople:
    changes, is_video = ImageChanges(), frame_rate(video) is not None
    times = frame_times(video, timestamps(video, None, changes.add)) if is_video else AT_30_HZ
    for image in () if is_video else decode(video):
        changes.add(image)
    people = read_view(folder, (0, None), UNKNOWN_IMAGES, None, video)
    cuts = changes.cuts(times.rate_hz).tolist()
    with single_blas_thread():
        return tracked_people(people, None, times.rate_hz, uneven_s=times.uneven_s, cuts=cuts)
