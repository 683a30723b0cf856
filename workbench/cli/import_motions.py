"""`workbench import`: import motion files into a motion library."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from workbench.motion.library import write_library
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import Reading, import_sources
from workbench.utils.errors import InputError

Unit = Literal["m", "cm", "mm", "inch", "cmu"]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


def import_motions(
    sources: Annotated[list[Path], typer.Argument(metavar="SOURCE", help="An .amc or .bvh file, or a folder.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.h5", help="The library to write.")],
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Resampling rate; default: the rate of the files.")
    ] = None,
    unit: Annotated[
        Unit | None,
        typer.Option(help="Unit of length; default: the file's, or cm, if the person then has a body's size."),
    ] = None,
    up: Annotated[
        Axis | None, typer.Option(help="Vertical axis; default: y, or z if the person stands along it.")
    ] = None,
    rate_hz: Annotated[
        float | None, typer.Option(metavar="HZ", help="Rate of AMC files; default: of index.csv, else 120 Hz.")
    ] = None,
    asf: Annotated[
        Path | None, typer.Option(metavar="FILE.asf", help="Skeleton of AMC files; default: the one in their folder.")
    ] = None,
    landmark: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT=NAME", help="The file's name of a joint, e.g. left_knee=LeftLeg; repeatable."),
    ] = None,
) -> int:
    """Import motion files into a motion library.

    Files that cannot be imported are reported and skipped; the exit code is
    then 2. If no file can be imported, no library is written.

    Examples:
      workbench import clips/ -o motions.h5
      workbench import dance.bvh jump.bvh -o motions.h5 --unit m --rate 60
      workbench import own.bvh -o motions.h5 --up z --landmark left_knee=Knee_L
    """
    if not output.parent.is_dir() or output.is_dir():  # before reading the files
        raise InputError(f"{output}: expected a file name in an existing folder")
    if wrong := [text for text in landmark or () if not all(text.partition("="))]:
        raise InputError(f"--landmark: expected JOINT=NAME, e.g. left_knee=LeftLeg, found {wrong[0]!r}")
    landmarks = dict(text.split("=", 1) for text in landmark) if landmark else None
    motions, reports = import_sources(sources, rate, Reading(unit, up, rate_hz, asf, landmarks))
    for report in reports:
        print(report, file=sys.stderr)
    if motions:
        write_library(output, motions)
    print("\n".join(_summary(motions)) if motions else f"nothing imported, {output} not written")
    return 2 if reports else 0


def _summary(motions: Sequence[Motion]) -> list[str]:
    """Return a table of clips, frames and mean joint residual after retargeting, by subject and in total."""
    lines = [f"{'subject':<12}{'clips':>7}{'frames':>9}{'error mm':>10}"]
    subjects = sorted({motion.subject for motion in motions})
    groups = [(subject, [motion for motion in motions if motion.subject == subject]) for subject in subjects]
    for name, group in [*groups, ("all", motions)]:
        frames = sum(map(len, group))
        error = sum(len(motion) * motion.joint_error_mm.mean() for motion in group) / frames
        lines.append(f"{name:<12}{len(group):>7}{frames:>9}{error:>10.1f}")
    return lines
