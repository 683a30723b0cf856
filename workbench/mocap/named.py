"""The motion a scene shows, by its name."""

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.mocap.generated.arm import bending_arm
from workbench.mocap.generated.gait import subjects, walker
from workbench.mocap.generated.running import runner, runners
from workbench.mocap.library import read_library
from workbench.mocap.motion import Motion
from workbench.mocap.sources import SUFFIXES, clip_name, find_clip, load_motion

_BUILTIN_SECONDS = 60.0
_BUILTIN_SEED = 1999  # keeps the walkers of "builtin" apart from those of `gait.builtin_motions`


def find_motion(name: str, *, data: str | None, rate_hz: float, path: str = "straight", seed: int = 0) -> Motion:
    """The motion called `name`, at `rate_hz`.

    "builtin": a generated walker of 60 s on a "straight" or "circle" path, another person for every seed;
    "builtin_run": a generated runner; "builtin_arm": a generated arm; a CMU clip such as "35_02" or a Bandai clip such
    as "dataset-1_guide_normal_001", looked up below the folder `data`; the path of an .amc or .bvh file;
    "FILE.h5:clip", a clip of a motion library. Raises InputError when there is no such motion.
    """
    if name == "builtin":
        (subject,) = subjects(1, np.random.default_rng([_BUILTIN_SEED, seed]))
        return walker(subject, _BUILTIN_SECONDS, rate_hz, path)
    if name == "builtin_run":
        (athlete,) = runners(1, np.random.default_rng([_BUILTIN_SEED, seed]))
        return runner(athlete, _BUILTIN_SECONDS, rate_hz)
    if name == "builtin_arm":
        return bending_arm(_BUILTIN_SECONDS, rate_hz)
    library = name.rpartition(":")[0]
    if library.endswith((".h5", ".hdf5")):
        motions = {motion.name: motion for motion in read_library(library)}
        if (clip := clip_name(name)) not in motions:
            raise InputError(f"{library}: no motion called {clip!r}, expected one of {', '.join(sorted(motions))}")
        return motions[clip].resampled(rate_hz)
    return load_motion(motion_file(name, data)).resampled(rate_hz)


def motion_file(name: str, data: str | None) -> Path:
    """The .amc or .bvh file of the motion called `name`, by its path or below the folder `data`, see `find_motion`.

    Raises InputError when there is no such file.
    """
    if name.lower().endswith(SUFFIXES):
        return Path(name).expanduser()
    if data is None:
        raise InputError(
            f"dataset: motion must be builtin, builtin_run, builtin_arm, FILE.amc, FILE.bvh, LIBRARY.h5:clip or a "
            f"recorded clip such as 35_02, which needs the folder with recordings (paths.data or $WORKBENCH_DATA); "
            f"found {name!r}"
        )
    try:
        return find_clip(data, name)
    except InputError as error:
        raise InputError(f"dataset: motion {name!r}: {error}") from None
