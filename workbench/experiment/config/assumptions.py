"""What a run is given beforehand: read off what its parts declare, and compared with what an experiment lists."""

from collections.abc import Mapping, Sequence

from omegaconf import DictConfig

from workbench.core.capabilities import IMAGES, KEYPOINTS, ONE_CAMERA, POINTS, START, Traits
from workbench.core.side_information import CAMERA, FIRST_FRAMES, MARKS, MEANING, RADII, START_POSE, TRAJECTORY
from workbench.experiment.config.compatibility import GROUPS, name_of, traits_of, unread
from workbench.utils.errors import InputError

WITH_CAMERA = frozenset({IMAGES, KEYPOINTS, ONE_CAMERA, POINTS})
"""What makes sense only to whom the calibration is given; it has put points into the world."""
WITH_SURFACE = frozenset({IMAGES, POINTS})
"""What shows the person's surface, not the joints alone."""


def givens(config: DictConfig, names: Mapping[str, str] | None = None) -> dict[str, str]:
    """Tell what a configuration's run is given, in the words of `core.given` and their order, and which part takes it.

    names: the options chosen, by group; the classes' names stand for those that are not given. A study is given
    nothing.
    """
    looked_at = ("body", *GROUPS) if config.get("inference") is not None else ()
    chosen = [group for group in looked_at if config.get(group) is not None and group not in unread(config)]
    traits = {group: traits_of(config[group]) for group in chosen}
    called = {group: name_of(config, group, names or {}) for group in chosen}
    offers = traits["dataset"].offers if "dataset" in traits else frozenset()
    taken: dict[str, str] = {}
    for group, part in traits.items():
        words = part.needs.get("given", frozenset()) | (part.needs.get("known", frozenset()) & offers)
        words |= {CAMERA} if WITH_CAMERA & part.needs.get("dataset", frozenset()) else set()
        taken |= dict.fromkeys(words - taken.keys(), called[group])
    if "inference" in traits and TRAJECTORY not in taken:  # which knows the first pose
        taken |= dict.fromkeys(_start(offers, traits["inference"]), called["inference"])
    shown = frozenset().union(*(part.needs.get("dataset", frozenset()) for part in traits.values()))
    unused = set() if WITH_SURFACE & shown else {RADII}
    return {word: taken[word] for word in MEANING if word in taken and word not in unused}


def _start(offers: frozenset[str], inference: Traits) -> set[str]:
    """Tell what an inference starts from, see `inference.start.poses`."""
    if START_POSE in offers:
        return {START_POSE}
    if MARKS in offers:
        return {MARKS, CAMERA}
    return {FIRST_FRAMES} if START in inference.needs.get("dataset", frozenset()) else set()


def check_given(config: DictConfig, names: Mapping[str, str] | None = None) -> None:
    """Raise InputError where the list `given` of a configuration is not what its parts take, naming part and word."""
    listed: Sequence[str] = config.given
    taken = givens(config, names)
    for word in listed:
        if word not in MEANING:
            raise InputError(f"given: no such word {word!r}, expected some of {', '.join(MEANING)}")
        if word not in taken:
            raise InputError(f"given: {word} ({MEANING[word]}) is listed, but no part takes it")
    for word, part in taken.items():
        if word not in listed:
            raise InputError(f"given: {part} takes {word} ({MEANING[word]}), which is not listed")
