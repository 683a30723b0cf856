"""Every purpose has its own random stream, and no two streams of a run are equal."""

import numpy as np
import pytest
import scipy.stats  # noqa: F401 (its import makes generators with fixed seeds)
from hydra import compose, initialize_config_module

from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.tracking import assemble, track
from workbench.utils.rng import stream


def test_a_stream_depends_on_seed_purpose_and_indices():
    first = stream(3, "clothes").random(4)
    assert (stream(3, "clothes").random(4) == first).all()
    others = [stream(4, "clothes"), stream(3, "wall"), stream(3, "clothes", 0), stream(3, "clothes", 1)]
    assert len({tuple(rng.random(4)) for rng in others} | {tuple(first)}) == 5


@pytest.fixture
def made_generators(monkeypatch):
    """Return a list of the generators made during a test, with their initial states."""
    generators = []
    default_rng = np.random.default_rng

    def recorded(*arguments):
        rng = default_rng(*arguments)
        generators.append((rng, str(rng.bit_generator.state)))
        return rng

    monkeypatch.setattr(np.random, "default_rng", recorded)
    return generators


@pytest.mark.parametrize(
    "overrides",
    [
        ["experiment=walk_straight"],
        pytest.param(["experiment=walk_cyclic", "likelihood=product"], marks=pytest.mark.slow),  # learns the edge model
        pytest.param(["experiment=points_run_steady"], marks=pytest.mark.slow),
        pytest.param(["experiment=points_particle_filter", "dataset.images=true"], marks=pytest.mark.slow),
        ["experiment=walk_keypoints_synthetic"],
        ["experiment=stereo_walk"],
    ],
    ids=" ".join,
)
def test_no_two_streams_of_a_run_are_equal(overrides, made_generators, tmp_path):
    prepare_hydra()
    settings = ["paths.data=null", "seed=5", f"paths.cache={tmp_path}", "dataset.n_frames=2"]
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[*overrides, *settings])
    if "n_particles" in config.inference:
        config.inference.n_particles = 20
    for _ in track(assemble(config), seed=5):
        pass
    used = [first for rng, first in made_generators if str(rng.bit_generator.state) != first]
    assert len(used) > 3
    assert len(set(used)) == len(used)
