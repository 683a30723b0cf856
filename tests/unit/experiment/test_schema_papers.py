"""What `paper=literal` makes of an experiment, and what it leaves alone."""

import pytest
import yaml
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

from workbench.experiment.config.options import options
from workbench.experiment.config.schema import prepare_hydra


def literal_of(option):
    return ((yaml.safe_load(option.text) or {}).get("when") or {}).get("paper.literal")


EXPERIMENTS = options("experiment")
OF_PAPERS = sorted(name for name, option in EXPERIMENTS.items() if literal_of(option) is not None)
AS_IT_STANDS = {"learn_walk", "learn_walk_run", "period_snr", "align_cycles", "impute_gaps"}
"""Those in which we do what the paper writes."""


def leaves(value, place=""):
    """Every value of a mapping with its place, but for what refers to something else."""
    if isinstance(value, dict):
        return {leaf for key, item in value.items() for leaf in leaves(item, f"{place}.{key}")}
    return set() if "${" in str(value) else {(place, str(value))}


@pytest.fixture(autouse=True)
def hydra_is_ready():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        yield


def composed(*overrides):
    return OmegaConf.to_container(compose("config", overrides=["paths.data=somewhere", *overrides]), resolve=True)


@pytest.mark.parametrize("experiment", OF_PAPERS)
def test_an_experiment_of_a_paper_composes_as_it_is_written(experiment):
    """All that is said comes to be; where nothing is said, ours is what the paper writes."""
    literal = composed(f"experiment={experiment}", "paper=literal")
    assert literal.pop("paper") == "literal"
    for place, keys in literal_of(EXPERIMENTS[experiment]).items():
        group, _, option = place.partition(".")
        if not option or literal[group]["_target_"] == options(group)[option].target:
            assert leaves(keys) <= leaves(literal[group]), place
    if experiment in AS_IT_STANDS:
        ours = composed(f"experiment={experiment}")
        assert ours.pop("paper") == "ours"
        assert ours == literal


def test_the_papers_have_their_experiments():
    """Every experiment whose comment begins with a paper's figure or section says how that is written."""
    named = {name for name, option in EXPERIMENTS.items() if option.about.startswith("Paper ")}
    beyond = {"balance_arm", "balance_arm_implicit", "points_full", "points_hybrid", "points_particle_filter"}
    assert named - beyond == set(OF_PAPERS)


@pytest.mark.parametrize("experiment", ["walk_best", "coverage", "custom"])
def test_an_experiment_of_no_paper_is_refused_in_one_sentence(experiment):
    with pytest.raises(HydraException, match=f"paper=literal: experiment={experiment} is in none of the papers"):
        composed(f"experiment={experiment}", "paper=literal")


def test_the_command_line_wins_over_the_paper():
    config = composed("experiment=walk_straight", "paper=literal", "likelihood.exponent=mean", "prior.n_components=3")
    assert (config["likelihood"]["exponent"], config["likelihood"]["occlusion"]) == ("mean", "limb")
    assert (config["prior"]["n_components"], config["prior"]["transition"]) == (3, "A")


def test_what_a_paper_writes_of_a_part_holds_where_that_part_is_chosen():
    config = composed("experiment=walk_straight", "paper=literal", "prior=gait", "likelihood=uniform")
    assert config["prior"]["transition"] == "stationary"
    assert "exponent" not in config["likelihood"]


def test_a_paper_is_said_last_and_an_experiment_says_it_after_the_one_it_begins_with():
    steady = composed("experiment=points_walk_steady", "paper=literal")["inference"]["problem"]
    assert (steady["frames_per_style"], steady["plain"]) == (None, True)  # one from each of two files
    alone = composed("experiment=walk_prior_only", "paper=literal")
    assert alone["prior"]["sigma_rotation"] == [0.03, 0.005, 0.005]
    assert alone["prior"]["transition"] == "A"


def test_a_part_that_an_experiment_has_on_the_command_line_is_as_its_paper_writes_it():
    prior = composed("experiment=arm_smooth_300", "prior=implicit", "paper=literal")["prior"]
    assert (prior["search"], prior["prediction"], prior["beta"]) == ("sign_tree", "copy", 1.0)
