"""Capabilities and requirements of components, declared by their classes and compared before any is constructed.

A capability that a component requires of another is declared here: code that uses it does not test types for it again.
One that is used where it is there, and required nowhere, is a protocol instead, such as `core.prior.Proposing`.

A class that a configuration names may have a static member `traits`: a `Traits`, or, if it depends on the component's
keys, a function from these to one. A nested component appears in the keys as its own traits. A class without the member
provides and requires nothing special.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

DENSITY = "a density that can be evaluated"
MOTION = "a motion model to fit"
ACTIVITY = "a motion model of activities"
BODY_PARTS = "independently sampled columns for joint angles"
SEPARABLE = "independently sampled columns"
RESIDUALS = "residuals that least squares can minimise"
IMAGES = "images"
POINTS = "points of the person's surface"
KEYPOINTS = "2-D joints"
ESTIMATED_CAMERA = "a camera that is estimated from the person"
ALL_JOINTS = "every joint of a motion file's skeleton"
LOOKAHEAD_WINDOWS = "recorded windows to look ahead in (look_ahead)"
EVIDENCE = "a density of the data"
UNIFORM_WEIGHTS = "particles of equal weight"
FIT = "a single pose estimate with particles about it"
START = "an initial pose, annotations, 2-D joints or points"


@dataclass(frozen=True)
class Traits:
    """Capabilities of a component, and its requirements of the others.

    provides: its capabilities. requires: the capabilities required of the dataset, the prior and the likelihood, by
    group; an empty group still requires that component. Four further groups of requires: `assumptions`, the
    `side_information` used in any case; `optional_assumptions`, that used if the dataset provides it;
    `conflicting_observations`, those the likelihood must not use, as this component uses them; `excluded`, capabilities
    that the dataset must not have. missing: a message on what its own nested components lack; empty: nothing.
    """

    provides: frozenset[str] = frozenset()
    requires: Mapping[str, frozenset[str]] = field(default_factory=dict)
    missing: str = ""


TraitsDeclaration = Traits | Callable[[Mapping[str, Any]], Traits]
Component = TypeVar("Component", bound=Callable[..., object])


def component_traits(*provides: str, **requires: str | tuple[str, ...]) -> Traits:
    """Return traits with these capabilities, and these requirements by group."""
    return Traits(
        frozenset(provides),
        {group: frozenset((words,) if isinstance(words, str) else words) for group, words in requires.items()},
    )


def declares_traits(traits: TraitsDeclaration) -> Callable[[Component], Component]:
    """Decorate a function with its traits, which a class has as a member."""

    def decorate(component: Component) -> Component:
        component.traits = traits  # type: ignore[attr-defined]
        return component

    return decorate


def combined_requirements(components: Mapping[str, Traits]) -> dict[str, frozenset[str]]:
    """Return the union of several components' requirements, by group."""
    every = components.values()
    groups = {group for traits in every for group in traits.requires}
    return {group: frozenset().union(*(traits.requires.get(group, ()) for traits in every)) for group in groups}


def common_capabilities(components: Mapping[str, Traits]) -> frozenset[str]:
    """Return the capabilities that all of several components provide."""
    return frozenset.intersection(*(traits.provides for traits in components.values())) if components else frozenset()
