"""`workbench track`: track a person in a video, from the file alone."""

from datetime import datetime
from pathlib import Path
from typing import Annotated

from typer import Argument, Exit, Option

from workbench.cli.export import estimated_track
from workbench.cli.run import run
from workbench.datasets.files.decode import count_frames
from workbench.motion.formats.motion_export import export, with_missing_frames
from workbench.recording.read.crash_probe import read_sound_run
from workbench.utils.errors import InputError

_EXPORTS = ("person.trc", "person.bvh", "person.csv")


def track(
    arguments: Annotated[
        list[str], Argument(metavar="VIDEO... [KEY=VALUE]...", help="Videos, and keys of experiment=video to set.")
    ],
    height: Annotated[
        float | None, Option(min=0.5, max=2.5, metavar="M", help="Of the person; default: an adult's.")
    ] = None,
    camera: Annotated[
        Path | None,
        Option(metavar="FILE.toml", help="Calibration; default: one camera, estimated from the person's height."),
    ] = None,
    model: Annotated[str, Option(metavar="full|heavy|PATH", help="Detector, see workbench detect.")] = "full",
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="DIR", help="Folder of the run; by default a new one."),
    ] = None,
) -> None:
    """Detect a person's joints in a video, fit the motion in 3-D, record it and export it.

    Several videos with one calibration file are one scene; its cameras have
    the names of the videos.

    \b
    Examples:
      workbench track walk.mp4 --height 1.72
      workbench track left.mp4 right.mp4 --camera rig.toml -o trial
    """
    videos = [Path(word) for word in arguments if "=" not in word]
    overrides = [word for word in arguments if "=" in word]
    if not videos:
        raise InputError("expected a video")
    if missing := [str(video) for video in videos if not video.exists()]:
        raise InputError(f"{', '.join(missing)}: no such video")
    if len(videos) > 1 and camera is None:
        raise InputError("several videos are one scene: expected their calibration, --camera FILE.toml")
    for video in videos:
        if count_frames(video, 2) < 2:
            raise InputError(
                f"{video}: expected a video or a folder of two images or more, found fewer; workbench detect finds the "
                "joints in a single image"
            )
    if output is None:
        output = Path("recordings", "runs", "video", f"{videos[0].stem}_{datetime.now():%Y-%m-%d_%H-%M-%S}")
    words = ["experiment=video", f"dataset.detector={model}", f"hydra.run.dir={output}"]
    if len(videos) == 1:
        words.append(f"dataset.source={videos[0]}")
        words += [] if height is None else [f"dataset.height_m={height}"]
    else:
        sources = ",".join(f"{video.stem}:{video}" for video in videos)
        words += ["dataset=multi_view", f"dataset.sources={{{sources}}}"]
        words += [] if height is None else [f"body.height_m={height}"]
    words += [] if camera is None else [f"dataset.calibration_file={camera}"]
    if code := run([*words, *overrides]):
        raise Exit(code)
    recorded = with_missing_frames(estimated_track(read_sound_run(output / "run.rrd")))
    for name in _EXPORTS:
        export(output / name, recorded, metres=False)
    print(f"exported: {', '.join(str(output / name) for name in _EXPORTS)}")
