"""workbench-import: motion files in, one motion library out."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from workbench.motion.library import write_library
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import import_sources
from workbench.utils.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """Import files and folders. Returns 0 when all is well, 2 when any was bad; the good ones are written either way.

    Where nothing could be imported no file is written.
    """
    parser = argparse.ArgumentParser(prog="workbench-import", description=__doc__)
    parser.add_argument("sources", metavar="SOURCE", nargs="+", type=Path, help=".amc or .bvh file, or a folder")
    parser.add_argument("-o", "--output", required=True, type=Path, help="the library to write, e.g. motions.h5")
    parser.add_argument("--rate", type=float, metavar="HZ", help="resample to this rate (default: as in the files)")
    parser.add_argument("--unit", choices=("cm", "m"), default="cm", help="unit of length of BVH files (default: cm)")
    arguments = parser.parse_args(argv)
    output: Path = arguments.output
    try:
        if not output.parent.is_dir() or output.is_dir():  # before the work, not after it
            raise InputError(f"{output}: expected the name of a file in a folder that exists")
        motions, reports = import_sources(arguments.sources, arguments.rate, arguments.unit)
        for report in reports:
            print(report, file=sys.stderr)
        if motions:
            write_library(output, motions)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(_summary(motions)) if motions else f"nothing imported, {output} not written")
    return 2 if reports else 0


def _summary(motions: Sequence[Motion]) -> list[str]:
    """A table of clips, frames and mean residual of the joints after retargeting, by subject and in total."""
    lines = [f"{'subject':<12}{'clips':>7}{'frames':>9}{'error mm':>10}"]
    subjects = sorted({motion.subject for motion in motions})
    groups = [(subject, [motion for motion in motions if motion.subject == subject]) for subject in subjects]
    for name, group in [*groups, ("all", motions)]:
        frames = sum(map(len, group))
        error = sum(len(motion) * motion.joint_error_mm.mean() for motion in group) / frames
        lines.append(f"{name:<12}{len(group):>7}{frames:>9}{error:>10.1f}")
    return lines
