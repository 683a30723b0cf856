"""Measure by how much the numbers of recordings move in other environments: `python -m analysis.tolerances FOLDER`.

Runs every recording of a folder with several seeds in the environments below and compares each with the run of the same
seed in the environment as it is. The result, FOLDER/tolerances.json, is what `workbench check` allows where a recording
was made in another environment.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy
from tqdm import tqdm

from workbench.recording.read.reader import Run, find_recordings, read
from workbench.recording.study.figures import numbers
from workbench.results.check.agreement import Agreement, agreement
from workbench.results.check.compare import number_of
from workbench.results.check.rerun import TOLERANCES
from workbench.utils.arrays import FloatArray

ENVIRONMENTS: Mapping[str, Mapping[str, str]] = {
    "OpenBLAS for Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "OpenBLAS for Zen": {"OPENBLAS_CORETYPE": "Zen"},
    "OpenBLAS for Prescott, NumPy without AVX2": {
        "OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    },
    "kernels for Haswell, NumPy without AVX-512": {
        "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+avx,+sse4.2,+popcnt,+bmi,+bmi2",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    },
    "kernels for any x86-64": {"NUMBA_CPU_NAME": "generic"},
}  # fmt: skip
LEVEL, MARGIN = 0.01, 3.0
"""How often, at most, any number of a recording is to leave its tolerance in an environment like those measured; and
times of the largest difference measured."""


def run_in(variables: Mapping[str, str], recordings: Sequence[Path], seed: int, folder: Path) -> dict[str, Run]:
    """Run the recordings with a seed in a process with these environment variables; the new runs by name."""
    command = [sys.executable, "-m", "workbench", "check", *map(str, recordings), "--run", "-o", str(folder)]
    done = subprocess.run(
        [*command, f"seed={seed}"], env={**os.environ, **variables}, capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1):
        sys.exit(f"{dict(variables)}: {done.stderr.strip()}")
    return {path.stem: read(folder / f"{k:03d}" / "run.rrd") for k, path in enumerate(recordings)}


def half_width(reference: FloatArray, others: FloatArray, n_numbers: int, chaotic: bool) -> float:
    """Return by how much a number may move.

    Parameters
    ----------
    reference
        Its values (S,) with S seeds in the reference environment.
    others
        Its values (E, S) in E others.
    n_numbers
        Metrics of the recording that are tested together.
    chaotic
        Whether any number of the recording moved by more than rounding.

    Returns
    -------
    float
        The half width of the interval in which the next difference d lies with the chance 1 − LEVEL / m, for n
        differences of mean 0 and m numbers: t(1 − LEVEL / (2 m); n) √(Σ dᵢ² / n) √(1 + 1/n), and at least MARGIN times
        the largest difference, as tails are heavy. A number that did not move where others of its run did may move as
        between two seeds.
    """
    d = (others - reference).ravel()
    if agreement(np.broadcast_to(reference, others.shape), others) <= Agreement.ROUNDING:
        rounding = 1e-6 * float(np.abs(reference).max())
        return max(rounding, float(np.ptp(reference))) if chaotic else rounding
    reach = scipy.stats.t.ppf(1.0 - LEVEL / (2 * n_numbers), d.size) * np.sqrt(1.0 + 1.0 / d.size)
    return max(float(reach * np.sqrt(np.mean(d**2))), MARGIN * float(np.abs(d).max()))


def measured(runs: Mapping[tuple[str, int], Mapping[str, Run]], seeds: Sequence[int]) -> dict[str, dict[str, float]]:
    """Return the tolerances by recording and metric; runs: by environment and seed, "" for the reference."""
    tolerances: dict[str, dict[str, float]] = {}
    places = sorted({place for place, _ in runs if place})
    for recording, first in runs["", seeds[0]].items():
        at = {key: by_name[recording] for key, by_name in runs.items()}
        reference = {name: np.array([number_of(name, at["", seed]) for seed in seeds]) for name in _names(first)}
        others = {
            name: np.array([[number_of(name, at[place, seed]) for seed in seeds] for place in places])
            for name in reference
        }  # fmt: skip
        same = (agreement(np.broadcast_to(reference[name], others[name].shape), others[name]) for name in reference)
        chaotic = any(each > Agreement.ROUNDING for each in same)
        sizes = {name: half_width(reference[name], others[name], len(reference), chaotic) for name in reference}
        pairs = [(at["", seed], at[place, seed]) for place in places for seed in seeds]
        tolerances[recording] = {name: float(f"{size:.2g}") for name, size in (sizes | _figures(pairs)).items()}
    return tolerances


def _names(run: Run) -> list[str]:
    return sorted({*run.result, *run.metrics})


def _figures(pairs: Sequence[tuple[Run, Run]]) -> dict[str, float]:
    """Return MARGIN times the largest difference of any number of a study's figures, of those that moved."""
    sizes: dict[str, float] = {}
    for was, now in pairs if pairs[0][0].is_study else ():
        for old, new in zip(was.figures, now.figures, strict=True):
            for before, after in zip(numbers(old).values(), numbers(new).values(), strict=True):
                if np.asarray(before).dtype.kind == "f" and agreement(before, after) > Agreement.ROUNDING:
                    size = MARGIN * float(np.nanmax(np.abs(np.subtract(after, before))))
                    sizes[f"figure {old.name}"] = max(sizes.get(f"figure {old.name}", 0.0), size)
    return sizes


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(prog="python -m analysis.tolerances", description=__doc__)
    parser.add_argument("folder", type=Path, help="with recordings, such as recordings/baselines")
    parser.add_argument("--seeds", type=int, default=3, help="how many (3)")
    arguments = parser.parse_args()
    recordings, seeds = find_recordings(arguments.folder), range(arguments.seeds)
    runs = {}
    with TemporaryDirectory(prefix="workbench-tolerances-") as place:
        jobs = [(name, seed) for name in ("", *ENVIRONMENTS) for seed in seeds]
        for k, (name, seed) in enumerate(tqdm(jobs, unit="environment and seed", disable=None)):
            runs[name, seed] = run_in(ENVIRONMENTS.get(name, {}), recordings, seed, Path(place, str(k)))
        content = {
            "environment": dict(next(iter(runs["", 0].values())).environment),
            "others": list(ENVIRONMENTS), "seeds": list(seeds), "tolerances": measured(runs, seeds),
        }  # fmt: skip
    (arguments.folder / TOLERANCES).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
