"""Imputation of missing joint angles: error in degrees by method and by how much was removed.

    python -m analysis.benchmarks.gaps --data DATA

DATA is the folder that holds cmu/. Samples of CMU walks are removed in blocks of 0.1–0.5 s per angle, or whole
markers (all angles of a limb) for half a cycle, and filled by linear interpolation, a periodic spline per sequence,
paper B's functional PCA and ours; by scikit-fda's FPCA too where it is installed. Parameters were chosen on the
subjects in TUNING only; the table of the others is the one to quote. --timing measures period, alignment and
functional PCA on 20 sequences of 19 angles and 5000 frames with 20 % missing.
"""

import argparse
import importlib.util
import time
from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT
from workbench.motion.models.cycle_alignment import Alignment, align
from workbench.motion.models.functional_pca import cut, fourier_basis, fpca_paper, fpca_shrunk
from workbench.motion.models.gaps import (
    METHODS,
    gap_study,
    gappy_sequences,
    motion_period,
    remove_blocks,
    remove_markers,
    rmse_deg,
)
from workbench.motion.models.imputation import reconstructed
from workbench.motion.models.period import find_period
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import cmu_clips, import_sources
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

TUNING = ("02", "05", "06", "07", "39")
HELD_OUT = ("08", "16", "32", "35", "38")
"""Subject 35 gave 20 clips, which are alike: the table without them is harder."""

FRACTIONS = (0.1, 0.2, 0.3)
SEED = 0


def main() -> None:
    parser = argparse.ArgumentParser(description="Imputation error of missing joint angles, in degrees.")
    parser.add_argument("--data", help="folder that holds cmu/")
    parser.add_argument("--timing", action="store_true", help="measure the time for 20 × 19 × 5000 samples instead")
    arguments = parser.parse_args()
    if arguments.timing:
        print_timing()
        return
    if arguments.data is None:
        parser.error("--data is needed, but for --timing")
    with_fda = importlib.util.find_spec("skfda") is not None
    if not with_fda:
        print("scikit-fda is not installed: its column is left out (pip install scikit-fda)\n")
    motions, bad = import_sources(cmu_clips(arguments.data, TUNING + HELD_OUT))
    for sentence in bad:
        print(f"left out: {sentence}")
    motions = with_period(motions)
    names = ("ours", "linear", "periodic", "paper") + (("scikit-fda",) if with_fda else ())
    print(f"{'subjects':<28}{'removed':<10}{'%':>3}{'clips':>7}" + "".join(f"{name:>12}" for name in names))
    held_out = [s for s in HELD_OUT if s != "35"]
    for title, subjects in (("tuning", TUNING), ("held out", HELD_OUT), ("held out without 35", held_out)):
        print_table(title, [motion for motion in motions if motion.subject in subjects], with_fda)


def with_period(motions: Sequence[Motion]) -> list[Motion]:
    """The motions whose period is found when nothing is missing; the others are named."""
    found = []
    for motion in motions:
        try:
            motion_period(motion, motion.poses[:, N_ROOT:])
            found.append(motion)
        except InputError as error:
            print(f"left out: {motion.name}: {error}")
    return found


def print_table(title: str, motions: Sequence[Motion], with_fda: bool) -> None:
    for removed, remove in (("blocks", remove_blocks), ("markers", remove_markers)):
        study = gap_study(motions, FRACTIONS, np.random.default_rng(SEED), remove)
        rng = np.random.default_rng(SEED)  # the same gaps again
        for fraction in FRACTIONS:
            percent = round(100 * fraction)
            errors = [study[f"rmse_deg_{percent}{method}"] for method in METHODS]
            if with_fda:
                truths, gappy, alignment = gappy_sequences(motions, fraction, rng, remove)
                errors.append(rmse_deg(truths, gappy, impute_scikit_fda(gappy, alignment)))
            clips = int(study[f"sequences_{percent}"])
            print(f"{title:<28}{removed:<10}{percent:>3}{clips:>7}" + "".join(f"{e:>12.2f}" for e in errors))


def impute_scikit_fda(sequences: Sequence[FloatArray], alignment: Alignment, q: int = 5) -> list[FloatArray]:
    """By scikit-fda's FPCA, which knows no gaps: q components per angle of the slices with the first guess in them."""
    from skfda import FDataGrid
    from skfda.preprocessing.dim_reduction import FPCA

    slices = cut(sequences, alignment)
    n_phases = slices.values.shape[1]
    phases = np.arange(n_phases) / n_phases
    curves = np.empty_like(slices.values)
    for angle in range(curves.shape[2]):
        fpca = FPCA(n_components=q)
        scores = fpca.fit_transform(FDataGrid(slices.values[:, :, angle], phases))
        curves[:, :, angle] = fpca.inverse_transform(scores).data_matrix[:, :, 0]
    spectra = fourier_basis(phases, n_phases).T @ curves
    models = reconstructed(sequences, alignment, slices, spectra)
    return [np.where(np.isfinite(series), series, model) for series, model in zip(sequences, models, strict=True)]


def print_timing() -> None:
    """Seconds for each stage on one core (set OPENBLAS_NUM_THREADS=1)."""
    sequences = planted_sequences(np.random.default_rng(SEED))
    clock = time.perf_counter()
    periods = [find_period(series, 50, 250) for series in tqdm(sequences, desc="period", disable=None)]
    laps = [("period", time.perf_counter())]
    alignment = align(sequences, periods)
    laps.append(("alignment", time.perf_counter()))
    slices = cut(sequences, alignment)
    laps.append(("slices", time.perf_counter()))
    paper = fpca_paper(slices)
    laps.append((f"functional PCA, the paper's, {len(paper.errors)} passes", time.perf_counter()))
    ours = fpca_shrunk(slices)
    laps.append((f"functional PCA, ours, {len(ours.errors)} passes", time.perf_counter()))
    print(f"20 sequences × 19 angles × 5000 frames, 20 % missing, {len(slices.values)} slices")
    for name, end in laps:
        print(f"{name:<45}{end - clock:>8.2f} s")
        clock = end


def planted_sequences(rng: np.random.Generator) -> list[FloatArray]:
    """20 sequences (5000, 19): smooth cycles of their own, five ways to vary from cycle to cycle, noise, gaps."""
    orders = np.arange(1, 9)
    waves = rng.standard_normal((6, 19, 8)) + 1j * rng.standard_normal((6, 19, 8))
    sequences = []
    for _ in range(20):
        phase = np.arange(5000) / rng.uniform(100.0, 160.0) + rng.uniform()
        turns = np.exp(2j * np.pi * phase[:, None] * orders) / orders
        curves = np.einsum("fo,kao->fka", turns, waves).real
        style = 0.3 * rng.standard_normal((1, 5)) + 0.1 * rng.standard_normal((60, 5))
        amounts = style[np.floor(phase).astype(np.int64)]
        series = curves[:, 0] + np.einsum("fk,fka->fa", amounts, curves[:, 1:])
        series += 0.05 * rng.standard_normal(series.shape)
        for angle in series.T:
            while np.isnan(angle).mean() < 0.2:
                start = rng.integers(5000 - 60)
                angle[start : start + rng.integers(12, 61)] = np.nan
        sequences.append(series)
    return sequences


if __name__ == "__main__":
    main()
