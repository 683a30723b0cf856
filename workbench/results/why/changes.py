"""What could have been otherwise in a run, one thing at a time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.datasets.rendering.perturbations import sizes

MORE = 4
"""So many times the particles are more of them."""
PRIORS = ("smooth", "jitter")
"""Tried in place of another: one that knows no activity, and one of a walk with freedom for every angle."""
CALIBRATION, START = ("camera", "camera_deg"), ("start_m", "start_rad")
"""Departures of what is told of the camera and of the first pose."""


@dataclass(frozen=True)
class Change:
    """One thing that is otherwise. name: what a person calls it. overrides: of the configuration. whole: it is of all
    frames, so that the run is repeated with it from the first on; else from shortly before the loss. mirrored: go on
    from the pose with left and right exchanged."""

    name: str
    overrides: tuple[str, ...] = ()
    whole: bool = False
    mirrored: bool = False


SAME, SAME_WHOLE = Change("nothing but the seed"), Change("nothing but the seed, from the first frame", whole=True)
"""What others are measured by."""


def changes_of(config: DictConfig, from_start: bool) -> list[Change]:
    """List what can be changed in a configuration, with what they are measured by; from_start: all futures go on from
    the first frame, so that one of the two is left out."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    of_cues = list(_cues(plain.get("likelihood") or {}))
    of_scene = list(_scene(plain["dataset"]))
    of_person = list(_person(plain["body"], plain["dataset"]))
    others = [*_particles(plain["inference"]), *of_cues, *_priors(plain["prior"]), *of_person, *of_scene]
    swapped = Change("left and right exchanged", mirrored=True)
    return [SAME, *([] if from_start else [SAME_WHOLE]), swapped, *others]


def _particles(inference: Mapping[str, Any]) -> Iterator[Change]:
    place, inner = "inference.n_particles", dict(inference)
    while inner:
        if inner.get("n_particles"):
            yield Change(f"{MORE} times the particles", (f"{place}={MORE * int(inner['n_particles'])}",))
            return
        place, inner = place.replace("n_particles", "filter.n_particles"), inner.get("filter") or {}


def _cues(likelihood: Mapping[str, Any]) -> Iterator[Change]:
    """Leave out each cue of several."""
    weights = {name: weight for name, weight in (likelihood.get("weights") or {}).items() if weight}
    if len(weights) > 1:
        for name in weights:
            yield Change(f"without {name}", (f"likelihood.weights.{name}=0.0",))


def _priors(prior: Mapping[str, Any]) -> Iterator[Change]:
    for name in PRIORS:
        if not str(prior["_target_"]).lower().endswith(name):
            yield Change(f"prior={name}", (f"prior={name}",), whole=True)


def _person(body: Mapping[str, Any], dataset: Mapping[str, Any]) -> Iterator[Change]:
    """The person's own lengths, where a scene knows them."""
    if "departures" not in dataset:
        return
    if not str(body["_target_"]).endswith("person.of_dataset"):
        yield Change("the person's own lengths", ("body=dataset",), whole=True)
    elif body.get("scale", 1.0) != 1.0:
        yield Change("the person's own lengths", ("body.scale=1.0",), whole=True)


def _scene(dataset: Mapping[str, Any]) -> Iterator[Change]:
    """What a rendered scene knows better than it tells, and what stands in the way in it."""
    if dataset.get("occluder"):
        yield Change("nothing in front of the person", ("dataset.occluder=false",), whole=True)
    if "departures" not in dataset:
        return
    told = sizes(bool(dataset.get("exact")), dataset["departures"])
    for name, which in (("the camera as it is", CALIBRATION), ("the first pose as it is", START)):
        if any(told[key] for key in which):
            exact = {**(dataset["departures"] or {}), **dict.fromkeys(which, 0.0)}
            words = ",".join(f"{key}:{value}" for key, value in exact.items())
            yield Change(name, (f"dataset.departures={{{words}}}",), whole=True)
