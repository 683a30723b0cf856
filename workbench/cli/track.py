"""`workbench track`: track a person in a video, from the file alone."""

import logging
import os
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

from omegaconf import OmegaConf
from typer import Argument, Exit, Option

from workbench.cli.export import estimated_track
from workbench.cli.hydra_quoting import literal
from workbench.cli.run import run
from workbench.datasets.video import Video
from workbench.detections.people_picture import NAME, write_people
from workbench.evaluation.verdict.run_findings import MOVING_CAMERA
from workbench.experiment.config.schema import composed
from workbench.motion.formats.motion_export import export, with_missing_frames
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.results.measure.display import headline
from workbench.results.measure.files import PAGE, write_measures
from workbench.results.measure.measures import measures_of
from workbench.results.overlay import MAX_SIDE_PX, SUFFIX, write_overlay
from workbench.results.pictures import camera_names
from workbench.utils.decode import count_frames
from workbench.utils.errors import InputError
from workbench.utils.finding import NOT_USABLE
from workbench.utils.run_files import OVERLAY, RECORDING, read_summary

_EXPORTS = ("person.trc", "person.bvh", "person.csv")
_RESUME = "sweep.resume="
_MIN_SEEN_S = 1.0
"""Shortest time for which --everyone tracks a person: about a stride."""
_NO_LIST_OF_JOBS = "hydra.hydra_logging.root.level=WARNING"
"""Setting of Hydra, which otherwise prints the overrides of each job."""


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
    everyone: Annotated[bool, Option("--everyone", help="Track every person, as the jobs of a sweep.")] = False,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="DIR", help="Folder of the run; by default a new one.")
    ] = None,
) -> None:
    """Detect a person's joints in a video, fit the motion in 3-D, record, export and measure it.

    Several videos with one calibration file are one scene; its cameras have
    the names of the videos. With --each, every video is a scene of its own,
    in a numbered folder; sweep.resume=DIR resumes such a sweep. With --everyone,
    every person who is detected for a second or more has such a folder. In both,
    the motion of runs that are not usable is not exported.

    \b
    Examples:
      workbench track walk.mp4 --height 1.72
      workbench track left.mp4 right.mp4 --camera rig.toml -o trial
      workbench track trials/*.mp4 --each -o trials hydra/launcher=joblib
      workbench track street.mp4 --everyone -o people
    """
    videos = [word for word in arguments if "=" not in word or os.path.exists(word)]
    overrides = [word for word in arguments if word not in videos]
    if everyone and (each or len(videos) > 1):
        raise InputError(f"--everyone: expected one video, found {len(videos)}; call it once for each")
    _check_videos(videos, one_scene=not each, calibrated=camera is not None)
    resumed = next((Path(word.removeprefix(_RESUME)) for word in overrides if word.startswith(_RESUME)), None)
    is_sweep = each or everyone
    new = f"{Path(videos[0]).stem}_{datetime.now():%Y-%m-%d_%H-%M-%S}"
    folder = resumed or output or Path("recordings", "sweeps" if is_sweep else "runs", "video", new)
    words = ["experiment=video", f"dataset.detector={literal(model)}", *_scene(videos, not each, height)]
    words += [] if camera is None else [f"dataset.calibration_file={literal(str(camera))}"]
    words += overrides
    people = _people(words) if everyone else []
    words += [f"dataset.person={','.join(map(str, people))}"] if everyone else []
    sources = [Path(video) for video in videos] * max(len(people), 1) if each or len(videos) == 1 else [None]
    options = ["-m", f"hydra.sweep.dir={folder}", _NO_LIST_OF_JOBS] if is_sweep else [f"hydra.run.dir={folder}"]
    code = run([*options, *words])
    runs = [folder / str(job) for job in range(len(sources))] if is_sweep else [folder]
    for place, source in zip(runs, sources, strict=True):
        summary = read_summary(place) or {}
        if summary.get("status") == "complete":
            _export(place, source, motion=not is_sweep or summary["verdict"]["level"] != NOT_USABLE)
            _show_people(place)
    if code:
        raise Exit(code)


def _people(words: list[str]) -> list[int]:
    """Return the numbers of the people of a configured video who are detected for _MIN_SEEN_S or more."""
    keys = dict[str, Any](OmegaConf.to_container(composed(words).dataset, resolve=True))  # type: ignore[arg-type]
    keys.pop("_target_")
    video = Video(**keys)
    people = video.people
    if people is None:
        raise InputError(f"{video.path}: --everyone: expected detections of people, found annotations of one person")
    n_frames = {number: sum(number in frame.values() for frame in people.assigned) for number in people.numbers}
    seen = [number for number, n in n_frames.items() if n >= min(_MIN_SEEN_S * video.times.rate_hz, len(people.frames))]
    if not seen:
        raise InputError(f"{video.path}: --everyone: expected a person who is detected for {_MIN_SEEN_S:g} s")
    print(f"{video.path}: {len(seen)} of {len(n_frames)} people are detected for {_MIN_SEEN_S:g} s or more")
    return seen


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


def _export(folder: Path, source: Path | None, motion: bool) -> None:
    """Write the overlay of each camera and the estimated motion of a run into its folder.

    source : the run's only video. motion : write the motion and its measures, too.
    """
    run = read_sound_run(folder / RECORDING)
    overlays = _overlays(camera_names(run))
    for camera, name in overlays.items():
        write_overlay(run, folder / name, camera, source=source, max_side_px=MAX_SIDE_PX)
    names = _export_motion(folder, run) if motion else ()
    print(f"exported: {', '.join(str(folder / name) for name in (*overlays.values(), *names))}")
    if names:
        _measure(folder, run)
    elif motion:
        print(f"{folder}: the person is tracked in a single frame, which is no motion to export")
    else:
        print(f"{folder}: not usable, so its motion is not exported; workbench export {folder / RECORDING} does")
    findings = ((read_summary(folder) or {}).get("verdict") or {}).get("findings", ())
    if motion and any(finding["kind"] == MOVING_CAMERA for finding in findings):
        print("the exported positions are relative to the camera, which travels, and not to the ground")


def _export_motion(folder: Path, run: Run) -> tuple[str, ...]:
    """Write the estimated motion into a folder; return the names of the files, none for a single frame."""
    estimate = estimated_track(run)
    names = _EXPORTS if len(estimate.frames) > 1 else ()
    for name in names:
        export(folder / name, with_missing_frames(estimate), metres=False)
    return names


def _measure(folder: Path, run: Run) -> None:
    measures = measures_of(run)
    write_measures(folder, folder.resolve().name, measures)
    print(f"measured: {headline(measures)}: {folder / PAGE}")


def _overlays(cameras: list[str]) -> dict[str, str]:
    """Return the name of each camera's overlay; the recording escapes special characters of the cameras' names."""
    if len(cameras) == 1:
        return {cameras[0]: OVERLAY}
    stem = Path(OVERLAY).stem
    names = [camera.replace("\\", "") for camera in cameras]
    return {camera: f"{stem}_{name}{SUFFIX}" for camera, name in zip(cameras, names, strict=True)}


def _show_people(folder: Path) -> None:
    """Write the picture of all people into the folder of a complete run of a single video."""
    keys = dict((read_summary(folder) or {})["settings"]["dataset"])
    if not keys.pop("_target_").endswith(f".{Video.__name__}"):
        return
    video = Video(**keys)
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)  # the run has logged how its detections were read
    try:
        people = video.people
    finally:
        logging.disable(level)
    if people is not None:
        write_people(folder / NAME, video.path, people)
        if (n_people := len(people.numbers)) > 1:
            print(f"{n_people} people, with the numbers of dataset.person=N: {folder / NAME}")
