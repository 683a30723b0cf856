"""Whom runs show: people repeat an experiment as seeds do, and numbers are means over them."""

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.motion.formats.names import GENERATED, left_out, performer
from workbench.results.report.protocol import SHOWN, half_of

MOTION = "dataset.motion"
HALF = "protocol.half"


def person_of(settings: Mapping[str, Any]) -> str:
    """Name whom a run's configuration shows: who performed the motion; of generated people each seed's is another.

    In a protocol that leaves out styles, Bandai's styles are people. Empty where there is no motion: a dataset of one's
    own shows one person.
    """
    dataset = settings.get("dataset") or {}
    motion = dataset.get("motion")
    if motion is None:
        return ""
    names = list(map(str, motion if isinstance(motion, list) else [motion]))
    people = left_out(names, by_style=half_of(settings) is not None)
    if any(name.startswith(GENERATED) for name in names):
        people.append(f"generated {dataset.get('seed', 0)}")
    return " and ".join(people)


def keys_of_people(settings: Sequence[Mapping[str, Any]]) -> set[str]:
    """Name the keys of flat settings that only say who is shown and left out, where recorded people are swept over.

    That is where the runs show clips of two known performers or more; otherwise no key.
    """
    motions = {str(row[MOTION]) for row in settings if row.get(MOTION) is not None}
    people = {performer(motion) for motion in motions}
    if len(people) < 2 or None in people:
        return set()
    drawn = set(SHOWN) if any(row.get(HALF) is not None for row in settings) else set()
    return {MOTION} | drawn | {key for row in settings for key in row if key.rpartition(".")[2] == "leave_out"}
