"""What can be changed in a run, read off its configuration."""

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from workbench.experiment.config.schema import prepare_hydra
from workbench.results.why.changes import SAME, SAME_WHOLE, changes_of


def changes(*overrides, from_start=False):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=["experiment=custom", *overrides, "paths.data=null"])
    return {each.name: each for each in changes_of(config, from_start)}


def test_one_thing_at_a_time():
    found = changes(
        "dataset=synthetic", "prior=walking", "likelihood=product", "dataset.occluder=true", "body.scale=1.2"
    )
    assert list(found) == [
        SAME.name, SAME_WHOLE.name, "left and right exchanged", "4 times the particles", "without image_motion",
        "without background", "without appearance", "without edges", "prior=smooth", "prior=jitter",
        "the person's own lengths", "nothing in front of the person", "the camera as it is", "the first pose as it is",
    ]  # fmt: skip
    assert found["4 times the particles"].overrides == ("inference.n_particles=20000",)
    assert found["without edges"].overrides == ("likelihood.weights.edges=0.0",)
    assert found["the person's own lengths"].overrides == ("body.scale=1.0",)
    assert found["the camera as it is"].whole
    assert not found["without edges"].whole


def test_nothing_is_offered_that_is_so_already():
    found = changes(
        "dataset=synthetic", "prior=smooth", "likelihood=image_motion", "dataset.exact=true", from_start=True
    )
    assert list(found) == [SAME.name, "left and right exchanged", "4 times the particles", "prior=jitter"]


@pytest.mark.parametrize(
    ("inference", "override"),
    [("restarting", "inference.filter.n_particles=20000"), ("annealed", "inference.n_particles=4000")],
)
def test_more_particles_are_of_the_filter_that_has_some(inference, override):
    assert changes("dataset=synthetic", f"inference={inference}")["4 times the particles"].overrides == (override,)


def test_what_is_said_of_the_camera_keeps_what_else_departs():
    found = changes("dataset=synthetic", "dataset.departures={camera_deg:2.0,lengths:0.1}")["the camera as it is"]
    (word,) = found.overrides
    assert OmegaConf.from_dotlist([word.replace(":", ": ")]).dataset.departures == {
        "camera_deg": 0.0, "lengths": 0.1, "camera": 0.0,
    }  # fmt: skip
