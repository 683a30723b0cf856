"""People in runs, and the splits of a protocol's runs: people repeat an experiment as seeds do."""

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
"""Keys that a protocol draws for every clip and seed, which do not distinguish groups of runs."""


def half_of(settings: Mapping[str, Any]) -> str | None:
    """Return the run's split of its protocol's clips; None without a protocol."""
    half = (settings.get("protocol") or {}).get("split")
    return None if half is None else str(half)


def person_of(settings: Mapping[str, Any]) -> str:
    """Return the performers of a configuration's motion; a generated person is another one for every seed.

    Each of Bandai's data sets counts as one person. "" without a motion: such a dataset shows one person.
    """
    dataset = settings.get("dataset") or {}
    motion = dataset.get("motion")
    if motion is None:
        return ""
    names = list(map(str, motion if isinstance(motion, list) else [motion]))
    people = excluded_subjects(names)
    if any(name.startswith(GENERATED) for name in names):
        people.append(f"generated {dataset.get('seed', 0)}")
    return " and ".join(people)


def keys_of_people(settings: Sequence[Mapping[str, Any]]) -> set[str]:
    """Return the keys of flat settings that select and exclude people, where runs are repeated over people.

    These are runs with clips of two known performers or more; otherwise there is no key.
    """
    motions = {str(row[MOTION]) for row in settings if row.get(MOTION) is not None}
    people = {performer(motion) for motion in motions}
    if len(people) < 2 or None in people:
        return set()
    drawn = set(_DRAWN) if any(row.get(_HALF) is not None for row in settings) else set()
    excluded = {key for row in settings for key in row if key.rpartition(".")[2] in ("exclude", "leave_out")}
    return {MOTION} | drawn | excluded
