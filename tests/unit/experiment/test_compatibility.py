"""What goes with what, and of whose likelihood the evidence can be compared."""

import pytest
from hydra import compose, initialize_config_module

from workbench.experiment.config.compatibility import incompatibility, no_evidence
from workbench.experiment.config.schema import prepare_hydra


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["experiment=walk_straight"], "likelihood=ImageMotion is not a density of the data"),
        (["experiment=walk_straight", "likelihood.exponent=sum"], "likelihood=ImageMotion is not"),
        (["experiment=walk_best"], "likelihood=Product is not"),
        (["experiment=walk_keypoints_synthetic", "inference=particle_filter"], "likelihood=KeypointLikelihood is not"),
        (["experiment=walk_keypoints_synthetic", "inference=particle_filter", "likelihood.temper=1.0"], None),
        (["experiment=synthesize_run"], "there is no likelihood"),
    ],
    ids=str,
)
def test_evidence_is_told_only_of_a_density_of_the_data(words, reason):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[*words, "paths.data=null"])
    found = no_evidence(config)
    assert found is None if reason is None else found.startswith(reason)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["experiment=synthesize_run", "prior=smooth"], "inference=Synthesis needs recorded windows to look ahead in"),
        (["experiment=points_full", "prior=smooth"], "dataset=Points needs every joint of a motion file's skeleton"),
        (["experiment=points_walk_steady", "prior.skeleton=full"], "prior=activity needs every joint"),
        (["experiment=points_full", "inference=synthesis"], "inference=Synthesis is not for every joint"),
        (["experiment=synthesize_run", "prior=smooth", "inference.look_ahead=0"], None),
    ],
    ids=str,
)
def test_what_cannot_work_is_said_in_a_sentence(words, sentence):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[*words, "paths.data=somewhere"])
    found = incompatibility(config, {})
    assert found is None if sentence is None else found.startswith(f"config: {sentence}")
