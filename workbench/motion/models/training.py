"""Learned models by the names of their training sets, with a cache."""

import hashlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from workbench.motion import full_skeleton, sources
from workbench.motion.formats.names import clip_name, style
from workbench.motion.library import read_library, write_library
from workbench.motion.models import activities as activity_models
from workbench.motion.models import activity_cycles, imputation, model_discrepancy, walking, windows
from workbench.motion.models import linear_motion as linear_motions
from workbench.motion.models.activities import ActivityModel, learn_activities
from workbench.motion.models.activity_cycles import PosedSkeleton, person_poses
from workbench.motion.models.imputation import with_gaps
from workbench.motion.models.linear_motion import LinearMotion, learn_linear_motion
from workbench.motion.models.model_discrepancy import learn_discrepancy
from workbench.motion.models.store import Provenance, Stored, cache_model, load
from workbench.motion.models.walking import ANGLES, WalkingModel, learn_cyclic, learn_walking
from workbench.motion.models.windows import Windows, learn_windows
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import cmu_clips, find_clip, find_sources, import_sources, read_clip
from workbench.motion.synthetic.gait import builtin_motions
from workbench.motion.synthetic.run_gait import builtin_runs
from workbench.utils.atomic_write import optional_cache
from workbench.utils.errors import InputError
from workbench.utils.input_path import expanded
from workbench.utils.rng import stream
from workbench.utils.source_hash import code_digest

log = logging.getLogger(__name__)
WALKERS = ("02", "05", "06", "07", "08", "16", "32", "39")  # CMU subjects of the training walks
WINDOWS_HZ = 30.0  # rate of the database of paper C
GAP_SEED = 2000  # seed of the gaps in `cyclic_model`, so that a training set determines the model


def walking_model(
    *, motions: str = "builtin", data: str | None = None, cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = WALKERS, exclude: Sequence[str] = (), variance: float = 0.95,
    n_components: int | None = 8, scaling: str = "joints", include_root: bool = False,
    torso_speed: str = "forward",
) -> WalkingModel:  # fmt: skip
    """Learn the walking model of paper A, or load it from the folder `cache`; see `training_motions`, `learn_walking`.

    The defaults fit the training subjects more closely than the paper's, which are those of the study `LearnWalk`.
    Raises InputError if the motions cannot be read or contain too few walking cycles.
    """
    training = training_motions(motions, data=data, cache=cache, subjects=subjects, exclude=exclude)
    options: dict[str, Any] = {
        "variance": variance, "n_components": n_components, "scaling": scaling, "include_root": include_root,
        "torso_speed": torso_speed,
    }  # fmt: skip
    code = code_digest(walking, model_discrepancy)

    def learn() -> WalkingModel:
        return _with_discrepancy(learn_walking(training, **options), training)

    return _learned(WalkingModel, "walking", cache, training, code, learn, **options)


def cyclic_model(
    *, motions: str = "builtin", data: str | None = None, cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = WALKERS, exclude: Sequence[str] = (), n_components: int = 8,
    missing_fraction: float = 0.0, as_published: bool = False,
) -> WalkingModel:  # fmt: skip
    """Learn the cyclic model of paper B, or load it from the folder `cache`; otherwise as `walking_model`.

    n_components : number of components. missing_fraction : fraction of the joint angles that is removed in blocks
    first. as_published : see `learn_cyclic`.
    """
    training = training_motions(motions, data=data, cache=cache, subjects=subjects, exclude=exclude)

    def learn() -> WalkingModel:
        rng = stream(GAP_SEED, "gaps")
        incomplete = [with_gaps(motion, missing_fraction, rng) for motion in training]
        return _with_discrepancy(learn_cyclic(incomplete, n_components, as_published=as_published), training)

    code = code_digest(walking, imputation, model_discrepancy)
    return _learned(
        WalkingModel, "cyclic", cache, training, code, learn, n_components=n_components,
        missing_fraction=missing_fraction, gap_seed=GAP_SEED, as_published=as_published,
    )  # fmt: skip


def _with_discrepancy(model: WalkingModel, training: Sequence[Motion]) -> WalkingModel:
    """Return the model with its discrepancy on held-out walkers, for the same number of components."""
    cycles, subjects = walking.walking_cycles(training), {motion.name: motion.subject for motion in training}
    labels, curves = [subjects[source] for source in cycles.sources], cycles.curves[:, :, ANGLES]
    names, n_components = walking.CHANNEL_NAMES[ANGLES], len(model.scales)
    return replace(model, discrepancy=learn_discrepancy(names, curves, cycles.durations_s, labels, n_components))


def motion_windows(
    *, motions: str = "recorded", data: str | None = None, cache: str = "~/.cache/workbench",
    exclude: Sequence[str] = (), activities: Sequence[str] = (), angles: Sequence[str] = ("body",),
    include_root: bool = True, rate_hz: float | None = None, window_frames: int | None = None,
    frames_hz: float | None = None, scaling: str = "deviations",
) -> Windows:  # fmt: skip
    """Learn the database of paper C, or load it from the folder `cache`; see `database_motions` and `learn_windows`.

    frames_hz : rate of the frames to track, if known. rate_hz : Hz; None: `frames_hz`, or 30 Hz if that is close to
    30 Hz or None. window_frames : None: a third of a second. Raises InputError if the motions are unreadable or too
    short.
    """
    if rate_hz is None:  # to 5 %, within which the prior treats a frame as one row
        rate_hz = WINDOWS_HZ if frames_hz is None or abs(frames_hz / WINDOWS_HZ - 1.0) < 0.05 else frames_hz
    window_frames = max(2, round(rate_hz / 3.0)) if window_frames is None else window_frames
    chosen = database_motions(motions, data=data, cache=cache, exclude=exclude, activities=activities)
    options: dict[str, Any] = {
        "include_root": include_root, "rate_hz": rate_hz, "window_frames": window_frames, "scaling": scaling,
    }  # fmt: skip
    code, learn = code_digest(windows), lambda: learn_windows(chosen, angles=angles, **options)
    return _learned(Windows, "windows", cache, chosen, code, learn, angles=",".join(angles), **options)


def linear_motion(
    *, motions: str = "recorded", data: str | None = None, cache: str = "~/.cache/workbench",
    exclude: Sequence[str] = (), activities: Sequence[str] = (), rate_hz: float | None = None,
    frames_hz: float | None = None,
) -> LinearMotion:  # fmt: skip
    """Learn the linear model of all `motions`, or load it; see `database_motions` and `learn_linear_motion`.

    rate_hz : Hz. None: `frames_hz`, the rate of the frames to track, or 30 Hz if that is unknown.
    """
    rate_hz = (frames_hz or WINDOWS_HZ) if rate_hz is None else rate_hz
    chosen = database_motions(motions, data=data, cache=cache, exclude=exclude, activities=activities)
    code, learn = code_digest(linear_motions), lambda: learn_linear_motion(chosen, rate_hz)
    return _learned(LinearMotion, "linear", cache, chosen, code, learn, rate_hz=rate_hz)


def activity_model(
    *, motions: str = "builtin", data: str | None = None, cache: str = "~/.cache/workbench",
    exclude: Sequence[str] = (), activities: Sequence[str] = ("walk", "run"), angles: Sequence[str] = ("body",),
    variance: float = 0.9, n_components: int | None = None, max_per_clip: int = 4, skeleton: str = "person",
) -> ActivityModel:  # fmt: skip
    """Learn the motion model of paper D, or load it from the folder `cache`.

    For the parameters see `database_motions`, `learn_activities` and `activity_cycles`. skeleton : "person", or "full"
    for every joint of the files' skeleton, which must be the same in all files. Raises InputError if the motions cannot
    be read, contain too few cycles, or do not have this skeleton.
    """
    if skeleton not in ("person", "full"):
        raise InputError(f"prior: skeleton must be person or full, found {skeleton!r}")
    full = skeleton == "full"
    if full and (data is None or motions not in ("recorded", "cmu", "bandai")):
        raise InputError(
            "prior: skeleton=full requires recordings: set paths.data or $WORKBENCH_DATA, and motions=bandai"
        )
    if full and list(angles) != ["body"]:
        raise InputError(f"prior: skeleton=full models every joint angle, found angles={list(angles)}")
    chosen = database_motions(motions, data=data, cache=cache, exclude=exclude, activities=activities)

    def file_poses(motion: Motion) -> PosedSkeleton:
        clip = read_clip(find_clip(str(data), motion.name))
        return full_skeleton.full_skeleton(clip), full_skeleton.full_poses(clip)

    def learn() -> ActivityModel:
        poses_of = file_poses if full else person_poses
        all_cycles = activity_cycles.activity_cycles(chosen, max_per_clip=max_per_clip, poses_of=poses_of)
        modelled = all_cycles.angles if full else angles
        model = learn_activities(all_cycles, angles=modelled, variance=variance, n_components=n_components)
        cycles, subjects = all_cycles.of_angles(modelled), {motion.name: motion.subject for motion in chosen}
        labels, d = [subjects[source] for source in cycles.sources], len(model.scales)
        return replace(model, discrepancy=learn_discrepancy(model.angles, cycles.curves, cycles.durations_s, labels, d))

    code = code_digest(activity_models, full_skeleton, model_discrepancy)
    return _learned(
        ActivityModel, "activities", cache, chosen, code, learn, angles=",".join(angles), variance=variance,
        n_components=n_components, max_per_clip=max_per_clip, skeleton=skeleton,
    )  # fmt: skip


def training_motions(
    motions: str, *, data: str | None, cache: str, subjects: Sequence[str] | None, exclude: Sequence[str] = ()
) -> tuple[Motion, ...]:
    """Return walks: "builtin" (generated), "cmu" or "recorded" (both CMU's, under `data`), or a library FILE.h5.

    subjects : of CMU; None: all. exclude : names of clips, of their files, of performers or of styles, see
    `formats.names`. Raises InputError if they cannot be read or none remains.
    """
    if motions in ("cmu", "recorded"):
        included = None if subjects is None else [subject for subject in subjects if subject not in exclude]
        walks = _imported(cmu_clips(_folder(motions, data), included), expanded(cache), "cmu-walks")
    else:
        walks = _builtin_or_library(motions, "cmu, recorded")
    return _selected(walks, exclude)


def database_motions(
    motions: str, *, data: str | None, cache: str, exclude: Sequence[str] = (), activities: Sequence[str] = ()
) -> tuple[Motion, ...]:
    """Return motions: "recorded" (CMU's and Bandai's under `data`), "cmu", "bandai", "builtin" or a library FILE.h5.

    exclude : names of clips, of their files, of performers or of styles, see `formats.names`. activities : restrict to
    these; empty: all. Raises InputError if they cannot be read or none remains.
    """
    if motions in ("recorded", "cmu", "bandai"):
        folder = _folder(motions, data)
        names = ("cmu", "bandai") if motions == "recorded" else (motions,)
        library = _imported(find_sources([folder / name for name in names]), expanded(cache), motions)
    else:
        library = _builtin_or_library(motions, "recorded, cmu, bandai")
        library += builtin_runs() if motions == "builtin" else ()
    selected = _selected(library, exclude, activities)
    log.info("motion database: %d clips of %d", len(selected), len(library))
    return selected


def _selected(library: Sequence[Motion], exclude: Sequence[str], activities: Sequence[str] = ()) -> tuple[Motion, ...]:
    """Return the motions of no clip, subject or style in `exclude`, of the activities; InputError if none remains."""
    if others := [name for name in exclude if not isinstance(name, str)]:
        raise InputError(
            f"motions: exclude: expected names of clips or subjects, found {others[0]!r}; put it in quotes"
        )
    excluded = {clip_name(name) for name in exclude}
    selected = tuple(
        motion
        for motion in library
        if not excluded & {motion.name, motion.subject, style(motion.name)}
        and (not activities or motion.activity in activities)
    )
    if not selected:
        available = ", ".join(sorted({motion.activity for motion in library}))
        wanted = f" of {' or '.join(activities)}" if activities else ""
        without = f" without {', '.join(exclude)}" if exclude else ""
        count = f"found {len(library)} clips, of activity {available}"
        raise InputError(f"motions: expected clips{wanted}{without}, {count}")
    return selected


def _folder(motions: str, data: str | None) -> Path:
    if data is None:
        raise InputError(
            f"motions={motions} requires the folder with the recordings: set paths.data or $WORKBENCH_DATA"
        )
    return expanded(data)


def _builtin_or_library(motions: str, others: str) -> tuple[Motion, ...]:
    if motions == "builtin":
        return builtin_motions()
    if motions.endswith((".h5", ".hdf5")):
        return read_library(expanded(motions))
    raise InputError(f"motions must be builtin, {others} or a motion library FILE.h5, found {motions!r}")


def _imported(clips: Sequence[Path], cache: Path, name: str) -> tuple[Motion, ...]:
    library = cache / "motions" / f"{name}-{_digest(clips)[:16]}.h5"
    if library.is_file():
        return read_library(library, own=True)
    motions, errors = import_sources(clips)
    for error in errors:
        log.warning("excluded from the training set: %s", error)
    with optional_cache():
        library.parent.mkdir(parents=True, exist_ok=True)
        write_library(library, motions)
    return tuple(motions)


def _digest(paths: Sequence[Path]) -> str:
    digest = hashlib.sha256(code_digest(sources).encode())
    skeletons = {skeleton for path in paths for skeleton in path.parent.glob("*.asf")}
    for path in sorted({*paths, *skeletons}):
        digest.update(f"{path.name}:".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _learned(
    kind: type[Stored], name: str, cache: str, training: Sequence[Motion], code: str, learn: Callable[[], Stored],
    **parameters: str | float | int | None,
) -> Stored:  # fmt: skip
    """Return the model of these motions, code and parameters from the folder `cache`; else learn and cache it."""
    sources = {f"{motion.source}#{motion.name}": motion.sha256 for motion in training}
    licences = tuple(sorted({motion.licence for motion in training}))
    provenance = Provenance(sources, parameters, licences, code)
    path = expanded(cache) / "models" / f"{name}-{provenance.key[:16]}.h5"
    if path.is_file():
        return load(kind, path)
    return cache_model(path, learn(), provenance)
