"""`workbench evaluate`: score motions that any program made against true ones."""

from pathlib import Path
from typing import Annotated

import typer

from workbench.evaluation.comparison.alignment import ALIGNMENTS, NONE
from workbench.evaluation.comparison.joint_motion import JointMotion
from workbench.motion.sources import Reading
from workbench.recording.write.two_skeletons import write_two_skeletons
from workbench.results.evaluate.evaluation import Compared, angle_table, compared, joint_table, score_table, trials_of
from workbench.results.evaluate.files import display, write_tables
from workbench.results.evaluate.joint_files import read_joints
from workbench.results.formatting import text
from workbench.utils.errors import InputError
from workbench.utils.run_files import RECORDING
from workbench.utils.text import printable


def evaluate(
    estimates: Annotated[
        list[Path],
        typer.Argument(
            metavar="ESTIMATE…", help="Motions: .trc, .c3d, .bvh, .amc, .csv, .npz, .mot, .rrd, a run's folder; or "
            "folders with one for each trial.",
        ),
    ],
    truth: Annotated[Path, typer.Option("--truth", metavar="FILE", help="The true motion, or a folder of trials.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder for tables and recordings.")
    ] = None,
    align: Annotated[
        str, typer.Option(metavar="|".join(ALIGNMENTS), help="Alignment in space of the estimate with the truth.")
    ] = NONE,
    offset: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Added to the estimates' clocks; by default estimated by the motion."),
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of length of the estimates; by default by the file.")] = None,
    up: Annotated[str | None, typer.Option(help="Vertical axis of the estimates; by default by the file.")] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Rate of estimates whose files have no times.")
    ] = None,
    truth_rate: Annotated[float | None, typer.Option(metavar="HZ", help="The same of the truth.")] = None,
) -> None:  # fmt: skip
    """Score motions that any program made against true ones, side by side.

    Joints are matched by name and anatomy; of .mot files only angles are scored. A
    recording has intervals, which are scored too; as the truth it stands for its true
    joints, if it has them.
    Prints each score with a 90 % interval: over the trials of a folder, or over the
    seconds of a single one. With -o it writes scores.csv, joints.csv, angles.csv,
    scores.md, scores.tex, and recordings of the estimates with the truth.

    Examples:
      workbench evaluate walk/run.rrd --truth markers.trc --align rigid
      workbench evaluate mine.trc theirs.csv --truth markers.c3d -o comparison
      workbench evaluate mine/ theirs/ --truth trials/ -o comparison
    """
    if align not in ALIGNMENTS:
        raise InputError(f"--align: expected one of {', '.join(ALIGNMENTS)}, found {align!r}")
    given, truths, scored = Reading(unit, up, rate), dict[Path, JointMotion](), dict[str, list[Compared]]()
    for name, estimate in zip(_names(estimates), estimates, strict=True):
        scored[name] = []
        for trial, own_file, true_file in trials_of(estimate, truth):
            if true_file not in truths:
                truths[true_file] = read_joints(true_file, Reading(rate_hz=truth_rate), truth=True)
            one = compared(trial, read_joints(own_file, given), truths[true_file], align, offset)
            scored[name].append(one)
            for note in one.notes:
                print(printable(note))
    scores = score_table(scored)
    shown = angle_table(scored).round(2).astype(object) if scores.empty else display(scores)
    print(f"\n{text(shown)}")
    parts = "trials" if max(map(len, scored.values())) > 1 else "seconds of the trial"
    words = f"; [90 % intervals] over the {parts}" if scores["low_90"].notna().any() else ""
    print(f"\nalignment: {align}{words}")
    if output is not None:
        paths = write_tables(output, scores, joint_table(scored), angle_table(scored))
        for name, trials in scored.items():
            for one in (each for each in trials if each.truth.names):
                path, own, true = output / f"{name}_{one.trial}.rrd", one.estimate, one.truth
                write_two_skeletons(path, true.names, true.times_s, own.positions, true.positions)
                paths.append(path)
        print(f"written: {', '.join(map(str, paths))}")


def _names(paths: list[Path]) -> list[str]:
    """Return short, different names of estimates: of their files, or of their folders where the files have one name."""
    files = [path.parent if path.name == RECORDING else path for path in paths]
    for names in ([path.stem for path in files], [f"{path.parent.name}_{path.stem}" for path in files]):
        if len(set(names)) == len(names):
            return names
    return [f"{k}_{path.stem}" for k, path in enumerate(paths, 1)]
