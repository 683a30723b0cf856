"""Time and memory of the commands, each a process of its own.

Compiling and sweeps are timed by the clock, and so want a quiet machine with two cores; starting is processor time,
which other load on the machine changes little.
"""

from pathlib import Path

import numpy as np
from tqdm import tqdm, trange

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.measuring import own_caches, peak_gb, process_s

RUN = ("-m", "workbench", "run", "experiment=walk_straight")
FEW, MANY = 64, 100_000  # particles
SHORT, LONG = 50, 5000  # frames
N_JOBS = 24
COMMANDS = {
    "help_s": (("--help",), 0, 0.3),
    "refusal_s": (("run", "experiment=walk_strait"), 2, 1.5),
    "default_run_s": (("run",), 0, 3.0),
}
"""Arguments, exit code and goal of the timed commands."""
WORKERS = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")


def memory_figures() -> list[Figure]:
    """Measure the peak memory of 10⁵ particles, and of 64."""
    with own_caches() as (folder, environment):
        run = [*RUN, "dataset.n_frames=5", f"hydra.run.dir={folder}/run"]
        each = [[*run, f"inference.n_particles={n}"] for n in (FEW, FEW, MANY)]  # the first one renders and compiles
        _, few, many = (peak_gb(command, environment) for command in tqdm(each, disable=None, leave=False))
    what = f"walk_straight, {MANY} particles; with {FEW} it is {few:.2f} GB"
    return [Figure("memory_1e5_gb", many, "GB", 1.5, "lower", what)]


def length_figures() -> list[Figure]:
    """Measure the peak memory of a long run beyond that of a short one."""
    module = "analysis.benchmarks.tracking"
    with own_caches() as (folder, environment):
        _, short, long = (peak_gb(["-m", module, str(n), f"{folder}/run"], environment) for n in (2, SHORT, LONG))
    what = f"walk_straight, {FEW} particles: {SHORT} frames take {short:.3f} GB, {LONG} {long:.3f} GB"
    return [Figure("memory_5000_frames_mb", max(1e3 * (long - short), 1.0), "MB", 100.0, "lower", what)]


def start_figures(repeats: int = 3) -> list[Figure]:
    """Measure two frames of walk_straight: compiling all kernels, and with the kernels of an earlier run."""
    with own_caches() as (folder, environment):
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        run = [*RUN, "dataset.n_frames=2", "inference.n_particles=64", "n_threads=1"]
        process_s([*run, f"hydra.run.dir={folder}/rendered", "likelihood=uniform"], environment)
        cold = []
        for i in range(repeats):
            for path in (Path(folder) / "kernels").rglob("*.nb?"):
                path.unlink()
            cold.append(process_s([*run, f"hydra.run.dir={folder}/cold_{i}"], environment))
        cached = [process_s([*run, f"hydra.run.dir={folder}/cached_{i}"], environment) for i in range(repeats)]
    started = np.min(cached, axis=0)
    clock, processor = np.min(cold, axis=0) - started
    what = "two frames of walk_straight"
    less = f"by the clock, {what}, less its time with cached kernels; {processor:.1f} s of processor time"
    return [
        Figure("start_compile_s", float(clock), "s", 8.0, "lower", less),
        Figure("start_cached_s", float(started[1]), "s", 2.5, "lower", f"processor time of {what}, kernels cached"),
    ]


def command_figures(repeats: int = 5) -> list[Figure]:
    """Measure, by the clock, the help, the refusal of a misspelt experiment, and a default run with cached kernels."""
    times: dict[str, float] = dict.fromkeys(COMMANDS, float("inf"))
    with own_caches() as (folder, environment):
        process_s(["-m", "workbench", "run", f"hydra.run.dir={folder}/first"], environment)  # compiles and renders
        for repeat in trange(repeats, disable=None, leave=False):
            for name, (arguments, code, _) in COMMANDS.items():
                into = [f"hydra.run.dir={folder}/{name}_{repeat}"] * (arguments[0] == "run")
                seconds, _ = process_s(["-m", "workbench", *arguments, *into], environment, code)
                times[name] = min(times[name], seconds)
    return [
        Figure(name, times[name], "s", bar, "lower", f"workbench {' '.join(arguments)}, by the clock")
        for name, (arguments, _, bar) in COMMANDS.items()
    ]


def sweep_figures(repeats: int = 2) -> list[Figure]:
    """Measure a sweep of short jobs by two workers against one job after another, on one thread and on two."""
    ways = {"alone": ["n_threads=1"], "all cores": ["n_threads=2"], "workers": ["n_threads=1", *WORKERS]}
    times: dict[str, float] = dict.fromkeys(ways, float("inf"))
    with own_caches() as (folder, environment):
        run = [*RUN, "-m", "dataset.n_frames=50", "inference.n_particles=6000"]
        process_s([*run, *WORKERS, "seed=0,1", f"hydra.sweep.dir={folder}/first"], environment)  # compiles and renders
        for repeat in range(repeats):
            for way, keys in ways.items():
                into = f"hydra.sweep.dir={folder}/{way.replace(' ', '_')}_{repeat}"
                seconds = process_s([*run, *keys, f"seed=range({N_JOBS})", into], environment)[0]
                times[way] = min(times[way], seconds)
    what = (
        f"{N_JOBS} jobs one after another: {times['alone']:.0f} s on one thread; on two {times['all cores']:.0f} s, "
        f"of which two workers take {times['workers'] / times['all cores']:.2f}"
    )
    return [Figure("two_workers", times["workers"] / times["alone"], "× its time", 0.55, "lower", what)]
