"""`workbench import`: import motion files into a motion library."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from workbench.motion.library import write_library
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import import_sources
from workbench.utils.errors import InputError


def import_motions(
    sources: Annotated[list[Path], typer.Argument(metavar="SOURCE", help="An .amc or .bvh file, or a folder.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.h5", help="The library to write.")],
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Resampling rate; default: the rate of the files.")
    ] = None,
    unit: Annotated[Literal["cm", "m"], typer.Option(help="Unit of length of BVH files.")] = "cm",
) -> int:
    """Import motion files into a motion library.

    Files that cannot be imported are reported and skipped; the exit code is
    then 2. If no file can be imported, no library is written.

    Examples:
      workbench import clips/ -o motions.h5
      workbench import dance.bvh jump.bvh -o motions.h5 --unit m --rate 60
    """
    if not output.parent.is_dir() or output.is_dir():  # before reading the files
        raise InputError(f"{output}: expected a file name in an existing folder")
    motions, reports = import_sources(sources, rate, unit)
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
