"""`workbench track`: track a person in a video, from the file alone."""

import os
from datetime import datetime
from pathlib import Path
from typing import Annotated

from typer import Argument, Exit, Option

from workbench.cli.export import estimated_track
from workbench.cli.hydra_quoting import literal
from workbench.cli.run import run
from workbench.datasets.video import Video
from workbench.detections.people_picture import NAME, write_people
from workbench.evaluation.verdict.run_findings import MOVING_CAMERA
from workbench.motion.formats.motion_export import export, with_missing_frames
from workbench.recording.read.crash_probe import read_sound_run
from workbench.utils.decode import count_frames
from workbench.utils.errors import InputError
from workbench.utils.run_files import RECORDING, read_summary

_EXPORTS = ("person.trc", "person.bvh", "person.csv")
_RESUME = "sweep.resume="


def track(
    arguments: Annotated[
        list[str], Argument(metavar="VIDEO... [KEY=VALUE]...", help="Videos, and keys of experiment=video to set.")
    ],
    height: Annotated[
        float | None, Option(min=0.5, max=2.5, metavar="M", help="Of the person; default: an adult's.")
    ] = None,
    camera: Annotated[
        Path | None,
        Option(metavar="FILE", help="Calibration; default: one camera, estimated from the person's height."),
    ] = None,
    model: Annotated[str, Option(metavar="full|heavy|PATH", help="Detector, see workbench detect.")] = "full",
    each: Annotated[bool, Option("--each", help="Track every video by itself, as the jobs of a sweep.")] = False,
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="DIR", help="Folder of the run; by default a new one."),
    ] = None,
) -> None:
    """Detect a person's joints in a video, fit the motion in 3-D, record it and export it.

    Several videos with one calibration file are one scene; its cameras have
    the names of the videos. With --each, every video is a scene of its own,
    in a numbered folder; sweep.resume=DIR resumes such a sweep.

    \b
    Examples:
      workbench track walk.mp4 --height 1.72
      workbench track left.mp4 right.mp4 --camera rig.toml -o trial
      workbench track trials/*.mp4 --each -o trials hydra/launcher=joblib
    """
    videos = [word for word in arguments if "=" not in word or os.path.exists(word)]
    overrides = [word for word in arguments if word not in videos]
    _check_videos(videos, one_scene=not each, calibrated=camera is not None)
    resumed = next((Path(word.removeprefix(_RESUME)) for word in overrides if word.startswith(_RESUME)), None)
    folder = resumed or output or _new_folder(videos[0], "sweeps" if each else "runs")
    options = ["-m", f"hydra.sweep.dir={folder}"] if each else [f"hydra.run.dir={folder}"]
    words = ["experiment=video", f"dataset.detector={literal(model)}", *_scene(videos, not each, height)]
    words += [] if camera is None else [f"dataset.calibration_file={literal(str(camera))}"]
    code = run([*options, *words, *overrides])
    runs = [folder / str(job) for job in range(len(videos))] if each else [folder]
    for complete in [place for place in runs if (read_summary(place) or {}).get("status") == "complete"]:
        _export(complete)
        _show_people(complete)
    if code:
        raise Exit(code)


def _scene(videos: list[str], one_scene: bool, height_m: float | None) -> list[str]:
    """Return the overrides for the videos, of one scene or each of its own, and the person's height."""
    if one_scene and len(videos) > 1:
        sources = ",".join(f"{Path(video).stem}:{literal(video)}" for video in videos)
        scene, height = ["dataset=multi_view", f"dataset.sources={{{sources}}}"], "body.height_m"
    else:
        scene, height = [f"dataset.source={','.join(map(literal, videos))}"], "dataset.height_m"
    return scene if height_m is None else [*scene, f"{height}={height_m}"]


def _check_videos(videos: list[str], one_scene: bool, calibrated: bool) -> None:
    """Raise InputError unless there are videos of two frames or more, and a calibration for several of one scene."""
    if not videos:
        raise InputError("expected a video")
    if missing := [video for video in videos if not Path(video).exists()]:
        raise InputError(f"{', '.join(missing)}: no such video")
    if one_scene and len(videos) > 1 and not calibrated:
        raise InputError(
            "several videos are one scene: expected their calibration, --camera FILE.toml, or --each for a run of each"
        )
    for video in map(Path, videos if one_scene else []):
        if count_frames(video, 2) < 2:
            raise InputError(
                f"{video}: expected a video or a folder of two images or more, found fewer; workbench detect finds the "
                "joints in a single image"
            )


def _new_folder(video: str, kind: str) -> Path:
    return Path("recordings", kind, "video", f"{Path(video).stem}_{datetime.now():%Y-%m-%d_%H-%M-%S}")


def _export(folder: Path) -> None:
    """Write the estimated motion of a run into its folder."""
    motion = with_missing_frames(estimated_track(read_sound_run(folder / RECORDING)))
    for name in _EXPORTS:
        export(folder / name, motion, metres=False)
    print(f"exported: {', '.join(str(folder / name) for name in _EXPORTS)}")
    verdict = (read_summary(folder) or {}).get("verdict") or {}
    if any(finding["kind"] == MOVING_CAMERA for finding in verdict.get("findings", ())):
        print("the exported positions are relative to the camera, which travels, and not to the ground")


def _show_people(folder: Path) -> None:
    """Write the picture of all people into the folder of a complete run of a single video."""
    keys = dict((read_summary(folder) or {})["settings"]["dataset"])
    if not keys.pop("_target_").endswith(f".{Video.__name__}"):
        return
    video = Video(**keys)
    if (people := video.people) is not None:
        write_people(folder / NAME, video.path, people)
        if (n_people := len(people.numbers)) > 1:
            print(f"{n_people} people, with the numbers of dataset.person=N: {folder / NAME}")
