"""What components provide to and require of each other, declared by their classes and compared before any is built.

A class that a configuration names may have a static member `traits`: a `Traits`, or where it depends on the part's keys
a function from these to one. A nested part is there with its own traits in place of its keys. A class without the
member provides nothing special and requires nothing special.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

DENSITY = "a density that can be evaluated"
GAUSSIAN = "Gaussian noise about a mean that is linear or nearly so"
MOTION = "a motion model to fit"
ACTIVITY = "a motion model of activities, to draw about its fit"
BODY_PARTS = "columns for joint angles that are drawn independently of each other"
SEPARABLE = "columns that are drawn independently of each other"
LIMB_COLUMNS = "columns for the twist and bend of a limb"
DERIVATIVES = "derivatives by the pose"
RESIDUALS = "residuals that least squares can minimise"
IMAGES = "images"
POINTS = "points of the person's surface"
KEYPOINTS = "2-D joints"
ONE_CAMERA = "a single camera"
ALL_JOINTS = "every joint of a motion file's skeleton"
LOOKAHEAD_WINDOWS = "recorded windows to look ahead in, as it is set to"
EVIDENCE = "a density of the data"
UNIFORM_WEIGHTS = "particles that all weigh the same"
FIT = "one pose, about which its particles are drawn"
START = "a pose, marks, 2-D joints or points to start from"


@dataclass(frozen=True)
class Traits:
    """Capabilities of a component, and its requirements of the others.

    provides: its capabilities. requires: those it needs of the dataset, the prior and the likelihood, by group; a group
    without any must be there all the same. Under `given` and `info` it lists the `side_information` that it uses: in
    any case, and where the dataset knows it. Under `apart` it lists observations that the likelihood must not use, as
    the component uses them for something else, under `without` what the dataset must not be like. missing: a sentence
    on what its own nested components lack, empty where they have it.
    """

    provides: frozenset[str] = frozenset()
    requires: Mapping[str, frozenset[str]] = field(default_factory=dict)
    missing: str = ""


Declared = Traits | Callable[[Mapping[str, Any]], Traits]
Part = TypeVar("Part", bound=Callable[..., object])


def offering(*offers: str, **needs: str | tuple[str, ...]) -> Traits:
    """Return traits with these capabilities, and these requirements by group."""
    return Traits(
        frozenset(offers),
        {group: frozenset((words,) if isinstance(words, str) else words) for group, words in needs.items()},
    )


def declaring(traits: Declared) -> Callable[[Part], Part]:
    """Give a function its traits, which a class has as a member."""

    def declare(part: Part) -> Part:
        part.traits = traits  # type: ignore[attr-defined]
        return part

    return declare


def needs_of_all(parts: Mapping[str, Traits]) -> dict[str, frozenset[str]]:
    """Return what several components require together, by group."""
    groups = {group for part in parts.values() for group in part.requires}
    return {group: frozenset().union(*(part.requires.get(group, ()) for part in parts.values())) for group in groups}


def offers_of_all(parts: Mapping[str, Traits]) -> frozenset[str]:
    """Return what each of several components provides."""
    return frozenset.intersection(*(part.provides for part in parts.values())) if parts else frozenset()
