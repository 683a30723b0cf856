"""Who is shown in runs, and how the runs of a protocol divide: people repeat an experiment as seeds do."""

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.motion.formats.names import GENERATED, excluded_subjects, performer

MOTION = "dataset.motion"
_HALF = "protocol.split"
_DRAWN = (
    "dataset.view_azimuth_deg",
    "dataset.first_frame",
    "dataset.occluder",
    "protocol.activity",
    "protocol.occlusion",
)
"""Keys that a protocol draws for every clip and seed, so that they do not tell groups of runs apart."""


def half_of(settings: Mapping[str, Any]) -> str | None:
    """Return the half of its protocol's clips that a run belongs to; None where there is no protocol."""
    half = (settings.get("protocol") or {}).get("split")
    return None if half is None else str(half)


def person_of(settings: Mapping[str, Any]) -> str:
    """Return who performed the motion that a configuration shows; of generated people each seed's is another.

    In a protocol that leaves out styles, Bandai's styles are people. Empty without a motion: such a dataset shows one
    person.
    """
    dataset = settings.get("dataset") or {}
    motion = dataset.get("motion")
    if motion is None:
        return ""
    names = list(map(str, motion if isinstance(motion, list) else [motion]))
    people = excluded_subjects(names, by_style=half_of(settings) is not None)
    if any(name.startswith(GENERATED) for name in names):
        people.append(f"generated {dataset.get('seed', 0)}")
    return " and ".join(people)


def keys_of_people(settings: Sequence[Mapping[str, Any]]) -> set[str]:
    """Return the keys of flat settings that only say who is shown and left out, where recorded people are swept over.

    That is where the runs show clips of two known performers or more; otherwise no key.
    """
    motions = {str(row[MOTION]) for row in settings if row.get(MOTION) is not None}
    people = {performer(motion) for motion in motions}
    if len(people) < 2 or None in people:
        return set()
    drawn = set(_DRAWN) if any(row.get(_HALF) is not None for row in settings) else set()
    excluded = {key for row in settings for key in row if key.rpartition(".")[2] in ("exclude", "leave_out")}
    return {MOTION} | drawn | excluded
