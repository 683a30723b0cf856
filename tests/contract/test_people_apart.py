"""Who is tracked is not learned from: every experiment, by the names of the motions that its priors say they know."""

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
"""Experiments that track somebody: synthesis starts from a clip, which alone is not in its database."""
GENERATED = ("ablation_inference", "coverage", "walk_circle", "walk_cyclic", "walk_straight")
"""Experiments that show a generated person, unless they are told otherwise."""
CMU = ("02_01", "02_03", "05_01", "06_01", "07_01", "08_01", "16_15", "32_02", "35_02", "35_15", "38_02", "39_02")
BANDAIS = [f"dataset-{k}_{kind}_normal_001" for k in (1, 2) for kind in ("walk", "run", "byebye")]


class AskedError(Exception):
    """Raised in place of learning; holds the names of the motions that would be learned from."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A folder with the names of recordings, and nothing in them."""
    folder = tmp_path_factory.mktemp("recordings")
    for clip in CMU:
        file = folder / "cmu" / clip[:2] / f"{clip}.amc"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    rows = [f"{clip},{clip[:2]},{'run' if clip == '02_03' else 'walk'},400,1,120\n" for clip in CMU]
    (folder / "cmu" / "index.csv").write_text(
        "clip,subject,activity,frames,first_frame_number,rate_hz\n" + "".join(rows)
    )
    for clip in BANDAIS:
        file = folder / "bandai" / clip[:9] / f"{clip}.bvh"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    return str(folder)


@pytest.fixture(autouse=True)
def nothing_is_read(monkeypatch):
    """Importing gives motions that have but the names that files and index say; learning only asks for names."""

    def imported(clips, cache, name):
        return tuple(map(named_only, clips))

    def asked(sources, *others):
        raise AskedError(sources)

    monkeypatch.setattr(training, "_imported", imported)
    monkeypatch.setattr(training, "Provenance", asked)


def named_only(file):
    bandai = file.suffix == ".bvh"
    subject = BANDAI[file.stem[:9]] if bandai else file.stem[:2]
    activity = file.stem.split("_")[1] if bandai else "walk"
    still = np.zeros((2, 25))
    return Motion(file.stem, subject, activity, 30.0, still, from_height(1.7), np.zeros(14), file.name, "", "")


def person_of(name):
    """Who moves, by a motion's name: CMU's number, Bandai's data set, somebody generated."""
    found = re.fullmatch(r"(\d+)_\d+|(dataset-\d+)_.*|((?:walker|runner)_.+)_straight", name)
    assert found, name
    return found[1] or found[2] or found[3]


def learned(node):
    """Every part of a configuration that learns from motions, in whatever prior."""
    if isinstance(node, dict):
        if "motions" in node and "exclude" in node:
            yield node
        for each in node.values():
            yield from learned(each)


def trained_on(node):
    """The people whose motions a part says it learned from."""
    keys = {key: value for key, value in node.items() if key != "_target_"}
    with pytest.raises(AskedError) as asked:
        import_target(node["_target_"])(**keys)
    (sources,) = asked.value.args
    return {person_of(source.rpartition("#")[2]) for source in sources}


def tracked(dataset):
    """The people whom a dataset shows; nobody of the recordings in a video."""
    names = dataset.get("motion") or []
    for name in map(clip_name, map(str, names if isinstance(names, list) else [names])):
        if name == "builtin_arm":
            yield "arm"
        elif name.startswith("builtin"):
            yield person_of(find_motion(name, data=None, rate_hz=30.0, seed=dataset.get("seed", 0)).name)
        else:
            yield person_of(name)


def check(recordings, *overrides):
    """Compose, and compare who is tracked with who is learned from; returns who is tracked."""
    config = OmegaConf.to_container(composed(*overrides), resolve=True)
    shown = set(tracked(config["dataset"]))
    for part in learned(config["prior"]):
        if part["data"] is not None or part["motions"] == "builtin":
            known = trained_on({**part, "data": part["data"] and recordings})
            assert known
            assert not known & shown, (overrides, part["_target_"])
    return shown


@pytest.mark.parametrize("experiment", TRACKED)
@pytest.mark.slow
def test_whoever_an_experiment_tracks_is_not_learned_from(experiment, recordings):
    check(recordings, f"experiment={experiment}")


@pytest.mark.parametrize(
    "experiment", [name if name in GENERATED else pytest.param(name, marks=pytest.mark.slow) for name in TRACKED]
)
def test_nor_is_whoever_it_is_told_to_track(experiment, recordings):
    chosen = [f"experiment={experiment}", "training.motions=recorded"]
    if "motion" in composed(f"experiment={experiment}").dataset:  # a video shows whom it shows
        assert check(recordings, *chosen, "dataset.motion=35_02") == {"35"}


@pytest.mark.slow
@pytest.mark.parametrize("experiment", TRACKED)
def test_nor_without_recordings(experiment):
    check(None, f"experiment={experiment}", "paths.data=null")


@pytest.mark.parametrize(
    "prior", ["walking", "gait", "cyclic", "activity", "implicit", "kinematic_flips", "ar_offsets_gait"]
)
def test_nor_by_any_other_prior(prior, recordings):
    check(recordings, f"prior={prior}", "dataset.motion=[02_01,dataset-1_walk_normal_001]", "training.motions=recorded")


def test_nor_by_the_database_that_an_arm_is_tracked_with(recordings):
    assert check(recordings, "experiment=arm_smooth_300", "prior=implicit") == {"dataset-1"}
