"""From the name of a training set to a learned model, through a cache."""

import hashlib
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from workbench.body import full_skeleton
from workbench.datasets.gait import builtin_motions
from workbench.datasets.running import builtin_runs
from workbench.digest import code_digest
from workbench.errors import InputError
from workbench.learning import activities as activity_models
from workbench.learning import (
    activity_cycles,
    alignment,
    cycles,
    cyclic,
    functional_pca,
    period,
    slices,
    walking,
    windows,
)
from workbench.learning.activities import ActivityModel, learn_activities, read_activities, write_activities
from workbench.learning.activity_cycles import Followed, followed_person
from workbench.learning.cyclic import learn_cyclic
from workbench.learning.gaps import with_gaps
from workbench.learning.store import Provenance, read_model, write_model
from workbench.learning.walking import WalkingModel, learn_walking
from workbench.learning.windows import Windows, learn_windows, read_windows, write_windows
from workbench.mocap import asf_amc, bvh, clip, retarget
from workbench.mocap.library import read_library, write_library
from workbench.mocap.motion import Motion
from workbench.mocap.sources import clip_name, cmu_clips, find_clip, find_sources, import_sources, read_clip

log = logging.getLogger(__name__)
Model = TypeVar("Model")

GAP_SEED = 2000
"""Of the gaps made for `cyclic_model`, so that one training set is one model."""


def walking_model(
    *,
    motions: str = "builtin",
    data: str | None = None,
    cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = ("02", "05", "06", "07", "08", "16", "32", "39"),
    variance: float = 0.95,
    n_components: int | None = None,
    scaling: str = "none",
) -> WalkingModel:
    """The walking model of paper A learned from `motions`, see `training_motions`; the others as for `learn_walking`.

    A model with the same sources and parameters is taken from the folder `cache` instead of being learned again.
    Raises InputError when the motions cannot be read or hold too few walking cycles.
    """
    return _walking(motions, data, cache, subjects, variance, n_components, scaling, root=False)


def gait_model(
    *,
    motions: str = "builtin",
    data: str | None = None,
    cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = ("02", "05", "06", "07", "08", "16", "32", "39"),
    n_components: int = 8,
) -> WalkingModel:
    """The walking model with how the root sways, channels scaled by their effect on the joints; see `walking_model`."""
    return _walking(motions, data, cache, subjects, 0.95, n_components, "joints", root=True)


def _walking(
    motions: str,
    data: str | None,
    cache: str,
    subjects: Sequence[str],
    variance: float,
    n_components: int | None,
    scaling: str,
    root: bool,
) -> WalkingModel:
    training = training_motions(motions, data=data, cache=cache, subjects=subjects)
    provenance = _provenance(
        training, code_digest(cycles, walking), variance=variance, n_components=n_components, scaling=scaling, root=root
    )
    return _cached(
        Path(cache).expanduser() / "models" / f"walking-{provenance.key[:16]}.h5",
        read_model,
        lambda: learn_walking(training, variance=variance, n_components=n_components, scaling=scaling, root=root),
        lambda path, model: write_model(path, model, provenance),
    )


def cyclic_model(
    *,
    motions: str = "builtin",
    data: str | None = None,
    cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = ("02", "05", "06", "07", "08", "16", "32", "39"),
    q: int = 5,
    missing: float = 0.0,
) -> WalkingModel:
    """The cyclic model of paper B with q components; `missing`: part of the joint angles removed in blocks beforehand.

    Otherwise as `walking_model`.
    """
    training = training_motions(motions, data=data, cache=cache, subjects=subjects)
    code = code_digest(cycles, walking, period, alignment, slices, functional_pca, cyclic)
    provenance = _provenance(training, code, q=q, missing=missing)

    def learn() -> WalkingModel:
        rng = np.random.default_rng(GAP_SEED)
        return learn_cyclic([with_gaps(motion, missing, rng) for motion in training], q)

    return _cached(
        Path(cache).expanduser() / "models" / f"cyclic-{provenance.key[:16]}.h5",
        read_model,
        learn,
        lambda path, model: write_model(path, model, provenance),
    )


def motion_windows(
    *,
    motions: str = "recorded",
    data: str | None = None,
    cache: str = "~/.cache/workbench",
    leave_out: Sequence[str] = (),
    activities: Sequence[str] = (),
    angles: Sequence[str] = ("body",),
    root: bool = True,
    rate_hz: float = 30.0,
    length: int = 10,
) -> Windows:
    """The database of paper C over `motions`, see `database_motions`; the others as for `learn_windows`.

    Raises InputError when the motions cannot be read or hold too few windows.
    """
    chosen = database_motions(motions, data=data, cache=cache, leave_out=leave_out, activities=activities)
    provenance = _provenance(
        chosen, code_digest(windows), angles=",".join(angles), root=root, rate_hz=rate_hz, length=length
    )
    return _cached(
        Path(cache).expanduser() / "models" / f"windows-{provenance.key[:16]}.h5",
        read_windows,
        lambda: learn_windows(chosen, rate_hz=rate_hz, length=length, angles=angles, root=root),
        lambda path, model: write_windows(path, model, provenance),
    )


def activity_model(
    *,
    motions: str = "builtin",
    data: str | None = None,
    cache: str = "~/.cache/workbench",
    leave_out: Sequence[str] = (),
    activities: Sequence[str] = ("walk", "run"),
    angles: Sequence[str] = ("body",),
    variance: float = 0.9,
    n_components: int | None = None,
    most_per_clip: int = 4,
    skeleton: str = "person",
) -> ActivityModel:
    """The motion model of paper D over `motions`, see `database_motions`; angles, variance and n_components as for
    `learn_activities`, most_per_clip as for `activity_cycles`.

    skeleton: "person", or "full" for every joint of the files' own skeleton, which must be one and the same.
    Raises InputError when the motions cannot be read or hold too few cycles, and for a skeleton they do not have.
    """
    followed = followed_person if skeleton == "person" else _own_skeletons(skeleton, motions, data, angles)
    chosen = database_motions(motions, data=data, cache=cache, leave_out=leave_out, activities=activities)
    provenance = _provenance(
        chosen,
        code_digest(cycles, retarget, activity_cycles, activity_models, full_skeleton),
        angles=",".join(angles),
        variance=variance,
        n_components=n_components,
        most_per_clip=most_per_clip,
        skeleton=skeleton,
    )

    def learn() -> ActivityModel:
        whole = activity_cycles.activity_cycles(chosen, most_per_clip=most_per_clip, followed=followed)
        modelled = angles if skeleton == "person" else whole.angles
        return learn_activities(whole, angles=modelled, variance=variance, n_components=n_components)

    return _cached(
        Path(cache).expanduser() / "models" / f"activities-{provenance.key[:16]}.h5",
        read_activities,
        learn,
        lambda path, model: write_activities(path, model, provenance),
    )


def _own_skeletons(
    skeleton: str, motions: str, data: str | None, angles: Sequence[str]
) -> Callable[[Motion], Followed]:
    """What gives a motion's file's own skeleton and its poses; InputError where there can be no such file."""
    if skeleton != "full":
        raise InputError(f"prior: skeleton must be person or full, found {skeleton!r}")
    if data is None or motions == "builtin":
        raise InputError("prior: skeleton=full needs recordings: set paths.data or $WORKBENCH_DATA, and motions=bandai")
    if list(angles) != ["body"]:
        raise InputError(f"prior: skeleton=full models every joint angle, found angles={list(angles)}")

    def followed(motion: Motion) -> Followed:
        clip = read_clip(find_clip(data, motion.name))
        return full_skeleton.full_skeleton(clip), full_skeleton.full_poses(clip)

    return followed


def training_motions(
    motions: str, *, data: str | None, cache: str, subjects: Sequence[str] | None
) -> tuple[Motion, ...]:
    """Walks: "builtin" (generated), "cmu" (recorded walks of `subjects`, None: all, under `data`) or a library FILE.h5.

    Raises InputError when they cannot be read.
    """
    if motions == "cmu":
        return _imported(cmu_clips(_folder(motions, data), subjects), Path(cache).expanduser(), "cmu-walks")
    return _builtin_or_library(motions, "cmu")


def database_motions(
    motions: str, *, data: str | None, cache: str, leave_out: Sequence[str] = (), activities: Sequence[str] = ()
) -> tuple[Motion, ...]:
    """Any motions: "recorded" (CMU's and Bandai's under `data`), "cmu", "bandai", "builtin" (generated walks and runs)
    or a library FILE.h5.

    leave_out: names of clips, of their files or of whole subjects. activities: keep only these; none keeps all.
    Raises InputError when they cannot be read or none is left.
    """
    if motions in ("recorded", "cmu", "bandai"):
        folder = _folder(motions, data)
        names = ("cmu", "bandai") if motions == "recorded" else (motions,)
        found = _imported(find_sources([folder / name for name in names]), Path(cache).expanduser(), motions)
    else:
        found = _builtin_or_library(motions, "recorded, cmu, bandai")
        found += builtin_runs() if motions == "builtin" else ()
    unwanted = {clip_name(name) for name in leave_out}
    kept = tuple(
        motion
        for motion in found
        if not unwanted & {motion.name, motion.subject} and (not activities or motion.activity in activities)
    )
    if not kept:
        raise InputError(f"motions: none of {len(found)} is left without {leave_out} among the activities {activities}")
    log.info("motion database: %d clips of %d", len(kept), len(found))
    return kept


def _folder(motions: str, data: str | None) -> Path:
    if data is None:
        raise InputError(f"motions={motions} needs the folder with the recordings: set paths.data or $WORKBENCH_DATA")
    return Path(data).expanduser()


def _builtin_or_library(motions: str, others: str) -> tuple[Motion, ...]:
    if motions == "builtin":
        return builtin_motions()
    if motions.endswith((".h5", ".hdf5")):
        return read_library(Path(motions).expanduser())
    raise InputError(f"motions must be builtin, {others} or a motion library FILE.h5, found {motions!r}")


def _imported(clips: Sequence[Path], cache: Path, name: str) -> tuple[Motion, ...]:
    library = cache / "motions" / f"{name}-{_digest(clips)[:16]}.h5"
    if not library.is_file():
        motions, bad = import_sources(clips)
        for sentence in bad:
            log.warning("left out of the training set: %s", sentence)
        library.parent.mkdir(parents=True, exist_ok=True)
        write_library(library, motions)
    return read_library(library)


def _digest(paths: Sequence[Path]) -> str:
    digest = hashlib.sha256(code_digest(asf_amc, bvh, clip, retarget).encode())
    skeletons = {skeleton for path in paths for skeleton in path.parent.glob("*.asf")}
    for path in sorted({*paths, *skeletons}):
        digest.update(f"{path.name}:".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _provenance(training: Sequence[Motion], code: str, **parameters: str | float | int | None) -> Provenance:
    return Provenance(
        sources={f"{motion.source}#{motion.name}": motion.sha256 for motion in training},
        parameters=parameters,
        licences=tuple(sorted({motion.licence for motion in training})),
        code=code,
    )


def _cached(
    path: Path, read: Callable[[Path], Model], learn: Callable[[], Model], write: Callable[[Path, Model], None]
) -> Model:
    if path.is_file():
        return read(path)
    model = learn()
    write(path, model)
    return model
