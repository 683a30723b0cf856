"""No experiment's prior is trained on motions of the people that the experiment tracks."""

import re

import numpy as np
import pytest
from compositions import TRACKING, composed
from omegaconf import OmegaConf

from workbench.body.shape import from_height
from workbench.experiment.config.instantiate import import_target
from workbench.motion.formats.names import BANDAI, clip_name
from workbench.motion.models import training
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import find_motion

TRACKED = sorted(set(TRACKING) - {"synthesize_run"})
"""Experiments that track people. Synthesis starts from a clip, and excludes only this clip from its database."""
GENERATED = ("ablation_inference", "coverage", "walk_circle", "walk_cyclic", "walk_straight")
"""Experiments that show a generated person by default."""
CMU = ("02_01", "02_03", "05_01", "06_01", "07_01", "08_01", "16_15", "32_02", "35_02", "35_15", "38_02", "39_02")
BANDAI_CLIPS = [f"dataset-{k}_{kind}_normal_001" for k in (1, 2) for kind in ("walk", "run", "byebye")]


class TrainingStartedError(Exception):
    """Raised in place of training; holds the names of the training motions."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return a folder of empty files with the names of recordings."""
    folder = tmp_path_factory.mktemp("recordings")
    for clip in CMU:
        file = folder / "cmu" / clip[:2] / f"{clip}.amc"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    rows = [f"{clip},{clip[:2]},{'run' if clip == '02_03' else 'walk'},400,1,120\n" for clip in CMU]
    (folder / "cmu" / "index.csv").write_text(
        "clip,subject,activity,frames,first_frame_number,rate_hz\n" + "".join(rows)
    )
    for clip in BANDAI_CLIPS:
        file = folder / "bandai" / clip[:9] / f"{clip}.bvh"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    return str(folder)


@pytest.fixture(autouse=True)
def no_training(monkeypatch):
    """Import motions by name without reading files, and stop when training starts."""

    def imported(clips, cache, name):
        return tuple(map(named_motion, clips))

    def training_started(sources, *others):
        raise TrainingStartedError(sources)

    monkeypatch.setattr(training, "_imported", imported)
    monkeypatch.setattr(training, "Provenance", training_started)


def named_motion(file):
    bandai = file.suffix == ".bvh"
    subject = BANDAI[file.stem[:9]] if bandai else file.stem[:2]
    activity = file.stem.split("_")[1] if bandai else "walk"
    still = np.zeros((2, 25))
    return Motion(file.stem, subject, activity, 30.0, still, from_height(1.7), np.zeros(14), file.name, "", "")


def person_of(name):
    """Return the person of a motion by its name: CMU's number, Bandai's data set or a generated person."""
    match = re.fullmatch(r"(\d+)_\d+|(dataset-\d+)_.*|((?:walker|runner)_.+)_straight", name)
    assert match, name
    return match[1] or match[2] or match[3]


def trained_components(node):
    """Yield the components of a configuration that are trained on motions, at any depth."""
    if isinstance(node, dict):
        if "motions" in node and "exclude" in node:
            yield node
        for value in node.values():
            yield from trained_components(value)


def training_people(node):
    """Return the people whose motions a component is trained on."""
    keys = {key: value for key, value in node.items() if key != "_target_"}
    with pytest.raises(TrainingStartedError) as error:
        import_target(node["_target_"])(**keys)
    (sources,) = error.value.args
    return {person_of(source.rpartition("#")[2]) for source in sources}


def tracked_people(dataset):
    """Yield the people that a dataset shows; a video shows none of the recorded people."""
    names = dataset.get("motion") or []
    for name in map(clip_name, map(str, names if isinstance(names, list) else [names])):
        if name == "builtin_arm":
            yield "arm"
        elif name.startswith("builtin"):
            yield person_of(find_motion(name, data=None, rate_hz=30.0, seed=dataset.get("seed", 0)).name)
        else:
            yield person_of(name)


def check(recordings, config):
    """Assert that no tracked person is in the training motions, and return the tracked people."""
    config = OmegaConf.to_container(config, resolve=True)
    tracked = set(tracked_people(config["dataset"]))
    for component in trained_components(config["prior"]):
        if component["data"] is not None or component["motions"] == "builtin":
            trained = training_people({**component, "data": component["data"] and recordings})
            assert trained
            assert not trained & tracked, component["_target_"]
    return tracked


@pytest.mark.parametrize("experiment", TRACKED)
@pytest.mark.slow
def test_tracked_people_are_not_in_the_training_motions(experiment, recordings):
    config = composed(f"experiment={experiment}").copy()
    check(recordings, config)
    config.paths.data = None  # then the people are generated
    check(None, config)


@pytest.mark.parametrize(
    "experiment", [name if name in GENERATED else pytest.param(name, marks=pytest.mark.slow) for name in TRACKED]
)
def test_people_chosen_by_the_user_are_not_in_the_training_motions(experiment, recordings):
    overrides = [f"experiment={experiment}", "training.motions=recorded"]
    if "motion" in composed(f"experiment={experiment}").dataset:  # videos have no motion
        assert check(recordings, composed(*overrides, "dataset.motion=35_02")) == {"35"}


@pytest.mark.parametrize("prior", ["walking", "gait", "cyclic", "activity", "implicit", "ar_offsets_gait"])
def test_any_other_prior_excludes_the_tracked_people(prior, recordings):
    motions = ["dataset.motion=[02_01,dataset-1_walk_normal_001]", "training.motions=recorded"]
    check(recordings, composed(f"prior={prior}", *motions))


def test_the_database_for_an_arm_excludes_the_tracked_person(recordings):
    assert check(recordings, composed("experiment=arm_smooth_300", "prior=implicit")) == {"dataset-1"}
