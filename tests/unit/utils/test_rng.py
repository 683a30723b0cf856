"""Every purpose has a stream of its own: nothing that a run draws repeats what another part of it drew."""

import numpy as np
import pytest
import scipy.stats  # noqa: F401 (which draws when it is imported, the same again and again)
from hydra import compose, initialize_config_module

from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.tracking import assemble, track
from workbench.utils.rng import stream


def test_a_stream_is_named_by_seed_purpose_and_indices():
    first = stream(3, "clothes").random(4)
    assert (stream(3, "clothes").random(4) == first).all()
    others = [stream(4, "clothes"), stream(3, "wall"), stream(3, "clothes", 0), stream(3, "clothes", 1)]
    assert len({tuple(rng.random(4)) for rng in others} | {tuple(first)}) == 5


@pytest.fixture
def made(monkeypatch):
    """Every generator made while a test runs, with its first state."""
    generators = []
    default_rng = np.random.default_rng

    def noted(*arguments):
        rng = default_rng(*arguments)
        generators.append((rng, str(rng.bit_generator.state)))
        return rng

    monkeypatch.setattr(np.random, "default_rng", noted)
    return generators


@pytest.mark.parametrize(
    "words",
    [
        ["experiment=walk_straight"],
        pytest.param(["experiment=walk_cyclic", "likelihood=product"], marks=pytest.mark.slow),  # learns what edges are
        pytest.param(["experiment=points_run_steady"], marks=pytest.mark.slow),
        pytest.param(["experiment=points_particle_filter", "dataset.images=true"], marks=pytest.mark.slow),
        ["experiment=walk_keypoints_synthetic"],
        ["experiment=stereo_walk"],
    ],
    ids=" ".join,
)
def test_no_two_streams_of_a_run_are_equal(words, made, tmp_path):
    prepare_hydra()
    usual = ["paths.data=null", "seed=5", f"paths.cache={tmp_path}", "dataset.n_frames=2"]
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=words + usual)
    if "n_particles" in config.inference:
        config.inference.n_particles = 20
    for _ in track(assemble(config), seed=5):
        pass
    used = [first for rng, first in made if str(rng.bit_generator.state) != first]
    assert len(used) > 3
    assert len(set(used)) == len(used)
