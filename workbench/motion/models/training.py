"""From the name of a training set to a learned model, through a cache."""

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
from workbench.motion.models.activity_cycles import Followed, followed_person
from workbench.motion.models.imputation import with_gaps
from workbench.motion.models.linear_motion import LinearMotion, learn_linear_motion
from workbench.motion.models.model_discrepancy import learn_discrepancy
from workbench.motion.models.store import Provenance, Stored, keep, load
from workbench.motion.models.walking import ANGLES, WalkingModel, learn_cyclic, learn_walking
from workbench.motion.models.windows import Windows, learn_windows
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import cmu_clips, find_clip, find_sources, import_sources, read_clip
from workbench.motion.synthetic.gait import builtin_motions
from workbench.motion.synthetic.run_gait import builtin_runs
from workbench.utils.atomic_write import optional_cache
from workbench.utils.errors import InputError
from workbench.utils.rng import stream
from workbench.utils.source_hash import code_digest

log = logging.getLogger(__name__)
WALKERS = ("02", "05", "06", "07", "08", "16", "32", "39")  # subjects of CMU whose walks are learned from
WINDOWS_HZ = 30.0  # rate of the database of paper C
GAP_SEED = 2000  # seed of the gaps made for `cyclic_model`, so that one training set is one model


def walking_model(
    *, motions: str = "builtin", data: str | None = None, cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = WALKERS, leave_out: Sequence[str] = (), variance: float = 0.95,
    n_components: int | None = 8, scaling: str = "joints", root: bool = False,
) -> WalkingModel:  # fmt: skip
    """Learn the walking model of paper A; motions, subjects, leave_out: `training_motions`, others: `learn_walking`.

    The defaults follow the training people more closely than the paper's, which are those of the study `LearnWalk`.
    A model with the same sources and parameters is taken from the folder `cache` instead of being learned again.
    Raises InputError when the motions cannot be read or hold too few walking cycles.
    """
    training = training_motions(motions, data=data, cache=cache, subjects=subjects, leave_out=leave_out)
    options: dict[str, Any] = {"variance": variance, "n_components": n_components, "scaling": scaling, "root": root}
    code = code_digest(walking, model_discrepancy)

    def learn() -> WalkingModel:
        return _with_discrepancy(learn_walking(training, **options), training)

    return _learned(WalkingModel, "walking", cache, training, code, learn, **options)


def cyclic_model(
    *, motions: str = "builtin", data: str | None = None, cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = WALKERS, leave_out: Sequence[str] = (), q: int = 8, missing: float = 0.0,
) -> WalkingModel:  # fmt: skip
    """Learn the cyclic model of paper B with q components; missing: part of the joint angles removed in blocks before.

    Otherwise as `walking_model`.
    """
    training = training_motions(motions, data=data, cache=cache, subjects=subjects, leave_out=leave_out)

    def learn() -> WalkingModel:
        rng = stream(GAP_SEED, "gaps")
        return _with_discrepancy(learn_cyclic([with_gaps(motion, missing, rng) for motion in training], q), training)

    code = code_digest(walking, imputation, model_discrepancy)
    return _learned(WalkingModel, "cyclic", cache, training, code, learn, q=q, missing=missing, gap_seed=GAP_SEED)


def _with_discrepancy(model: WalkingModel, training: Sequence[Motion]) -> WalkingModel:
    """Add the discrepancy of a model with as many components to walkers that are left out."""
    cycles, subjects = walking.walking_cycles(training), {motion.name: motion.subject for motion in training}
    people, curves = [subjects[source] for source in cycles.sources], cycles.curves[:, :, ANGLES]
    missed = learn_discrepancy(walking.CHANNEL_NAMES[ANGLES], curves, cycles.durations_s, people, len(model.scales))
    return replace(model, discrepancy=missed)


def motion_windows(
    *, motions: str = "recorded", data: str | None = None, cache: str = "~/.cache/workbench",
    leave_out: Sequence[str] = (), activities: Sequence[str] = (), angles: Sequence[str] = ("body",),
    root: bool = True, rate_hz: float | None = None, length: int | None = None, frames_hz: float | None = None,
) -> Windows:  # fmt: skip
    """Learn the database of paper C over `motions`, see `database_motions`; the others as for `learn_windows`.

    rate_hz: None takes the rate of the frames that are to be tracked, frames_hz, or 30 Hz where that is about it or not
    known. length: None takes a third of a second. Raises InputError for motions that are unreadable or too short.
    """
    if rate_hz is None:  # to 5 %, which the prior takes for one row a frame
        rate_hz = WINDOWS_HZ if frames_hz is None or abs(frames_hz / WINDOWS_HZ - 1.0) < 0.05 else frames_hz
    length = max(2, round(rate_hz / 3.0)) if length is None else length
    chosen = database_motions(motions, data=data, cache=cache, leave_out=leave_out, activities=activities)
    options: dict[str, Any] = {"root": root, "rate_hz": rate_hz, "length": length}
    code, learn = code_digest(windows), lambda: learn_windows(chosen, angles=angles, **options)
    return _learned(Windows, "windows", cache, chosen, code, learn, angles=",".join(angles), **options)


def linear_motion(
    *, motions: str = "recorded", data: str | None = None, cache: str = "~/.cache/workbench",
    leave_out: Sequence[str] = (), activities: Sequence[str] = (), rate_hz: float | None = None,
    frames_hz: float | None = None,
) -> LinearMotion:  # fmt: skip
    """Learn the linear model of all `motions`, see `database_motions` and `learn_linear_motion`.

    rate_hz: None takes the rate of the frames that are to be tracked, frames_hz, or 30 Hz where that is not known.
    """
    rate_hz = (frames_hz or WINDOWS_HZ) if rate_hz is None else rate_hz
    chosen = database_motions(motions, data=data, cache=cache, leave_out=leave_out, activities=activities)
    code, learn = code_digest(linear_motions), lambda: learn_linear_motion(chosen, rate_hz)
    return _learned(LinearMotion, "linear", cache, chosen, code, learn, rate_hz=rate_hz)


def activity_model(
    *, motions: str = "builtin", data: str | None = None, cache: str = "~/.cache/workbench",
    leave_out: Sequence[str] = (), activities: Sequence[str] = ("walk", "run"), angles: Sequence[str] = ("body",),
    variance: float = 0.9, n_components: int | None = None, most_per_clip: int = 4, skeleton: str = "person",
) -> ActivityModel:  # fmt: skip
    """Learn the motion model of paper D over `motions`, see `database_motions`; angles, variance and n_components as
    for `learn_activities`, most_per_clip as for `activity_cycles`.

    skeleton: "person", or "full" for every joint of the files' own skeleton, which must be one and the same.
    Raises InputError when the motions cannot be read or hold too few cycles, and for a skeleton they do not have.
    """
    if skeleton not in ("person", "full"):
        raise InputError(f"prior: skeleton must be person or full, found {skeleton!r}")
    full = skeleton == "full"
    if full and (data is None or motions not in ("recorded", "cmu", "bandai")):
        raise InputError("prior: skeleton=full needs recordings: set paths.data or $WORKBENCH_DATA, and motions=bandai")
    if full and list(angles) != ["body"]:
        raise InputError(f"prior: skeleton=full models every joint angle, found angles={list(angles)}")
    chosen = database_motions(motions, data=data, cache=cache, leave_out=leave_out, activities=activities)

    def file_skeleton(motion: Motion) -> Followed:
        clip = read_clip(find_clip(str(data), motion.name))
        return full_skeleton.full_skeleton(clip), full_skeleton.full_poses(clip)

    def learn() -> ActivityModel:
        followed = file_skeleton if full else followed_person
        whole = activity_cycles.activity_cycles(chosen, most_per_clip=most_per_clip, followed=followed)
        modelled = whole.angles if full else angles
        model = learn_activities(whole, angles=modelled, variance=variance, n_components=n_components)
        cycles, subjects = whole.of_angles(modelled), {motion.name: motion.subject for motion in chosen}
        people = [subjects[source] for source in cycles.sources]
        missed = learn_discrepancy(model.angles, cycles.curves, cycles.durations_s, people, len(model.scales))
        return replace(model, discrepancy=missed)

    code = code_digest(activity_models, full_skeleton, model_discrepancy)
    return _learned(
        ActivityModel, "activities", cache, chosen, code, learn, angles=",".join(angles), variance=variance,
        n_components=n_components, most_per_clip=most_per_clip, skeleton=skeleton,
    )  # fmt: skip


def training_motions(
    motions: str, *, data: str | None, cache: str, subjects: Sequence[str] | None, leave_out: Sequence[str] = ()
) -> tuple[Motion, ...]:
    """Get walks: "builtin" (generated), "cmu", "recorded" (both CMU's, under `data`) or a library FILE.h5.

    subjects: whose of CMU's, None: all. leave_out: names of clips, of their files, of performers or of styles, see
    `formats.names`. Raises InputError when they cannot be read or none is left.
    """
    if motions in ("cmu", "recorded"):
        kept = None if subjects is None else [subject for subject in subjects if subject not in leave_out]
        found = _imported(cmu_clips(_folder(motions, data), kept), Path(cache).expanduser(), "cmu-walks")
    else:
        found = _builtin_or_library(motions, "cmu, recorded")
    return _without(found, leave_out)


def database_motions(
    motions: str, *, data: str | None, cache: str, leave_out: Sequence[str] = (), activities: Sequence[str] = ()
) -> tuple[Motion, ...]:
    """Get motions: "recorded" (CMU's and Bandai's under `data`), "cmu", "bandai", "builtin" or a library FILE.h5.

    leave_out: names of clips, of their files, of performers or of styles (`formats.names`). activities: keep these;
    none keeps all. Raises InputError when they cannot be read or none is left.
    """
    if motions in ("recorded", "cmu", "bandai"):
        folder = _folder(motions, data)
        names = ("cmu", "bandai") if motions == "recorded" else (motions,)
        found = _imported(find_sources([folder / name for name in names]), Path(cache).expanduser(), motions)
    else:
        found = _builtin_or_library(motions, "recorded, cmu, bandai")
        found += builtin_runs() if motions == "builtin" else ()
    kept = _without(found, leave_out, activities)
    log.info("motion database: %d clips of %d", len(kept), len(found))
    return kept


def _without(found: Sequence[Motion], leave_out: Sequence[str], activities: Sequence[str] = ()) -> tuple[Motion, ...]:
    """Keep those of no clip, subject or style in `leave_out`, of some activities or any; InputError if none is left."""
    if others := [name for name in leave_out if not isinstance(name, str)]:
        raise InputError(
            f"motions: leave_out: expected names of clips or people, found {others[0]!r}; put it in quotes"
        )
    unwanted = {clip_name(name) for name in leave_out}
    kept = tuple(
        motion
        for motion in found
        if not unwanted & {motion.name, motion.subject, style(motion.name)}
        and (not activities or motion.activity in activities)
    )
    if not kept:
        shown = ", ".join(sorted({motion.activity for motion in found}))
        wanted = f" of {' or '.join(activities)}" if activities else ""
        without = f" without {', '.join(leave_out)}" if leave_out else ""
        raise InputError(f"motions: expected clips{wanted}{without}, found {len(found)} clips, of activity {shown}")
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
    if library.is_file():
        return read_library(library, own=True)
    motions, bad = import_sources(clips)
    for sentence in bad:
        log.warning("left out of the training set: %s", sentence)
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
    """Take the model of these motions, code and parameters from the folder `cache`; else learn it and keep it there."""
    sources = {f"{motion.source}#{motion.name}": motion.sha256 for motion in training}
    licences = tuple(sorted({motion.licence for motion in training}))
    provenance = Provenance(sources, parameters, licences, code)
    path = Path(cache).expanduser() / "models" / f"{name}-{provenance.key[:16]}.h5"
    if path.is_file():
        return load(kind, path)
    return keep(path, learn(), provenance)
