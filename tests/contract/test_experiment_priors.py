"""An experiment sets keys of the prior it is run with, and none of another's."""

import pytest
from hydra import compose, initialize_config_module

from workbench.cli.run import prepare_hydra


@pytest.mark.parametrize("experiment", ["walk_straight", "walk_prior_only"])
@pytest.mark.parametrize(("prior", "fixed"), [("walking", True), ("cyclic", True), ("smooth", False)])
def test_the_straight_walk_can_be_run_with_any_prior(experiment, prior, fixed):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[f"experiment={experiment}", f"prior={prior}"])
    assert config.prior.get("sigma_rotation") == ([0.0, 0.0, 0.0] if fixed else None)
