"""Any prior, likelihood and inference can be chosen in any experiment, which sets keys of its own choices alone."""

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import options
from workbench.experiment.config.schema import prepare_hydra
from workbench.motion.formats.names import performer

TRACKING = sorted(name for name, each in options("experiment").items() if "_study" not in each.text)


@pytest.fixture(autouse=True, scope="module")
def hydra_is_ready():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        yield


def composed(*overrides):
    return compose("config", overrides=[*overrides, "paths.data=somewhere"])


WHEN = [
    (experiment, place, keys)
    for experiment, option in sorted(options("experiment").items())
    for settings in [OmegaConf.create(option.text).get("if_chosen") or {}]
    for place, keys in [*settings.items(), *settings.get("paper.literal", {}).items()]
    if place not in ("paper.literal", "study")
]


def test_what_an_experiment_sets_of_a_part_are_keys_of_that_part():
    """Hydra refuses any other, see below, but only where the part is chosen."""
    for experiment, place, keys in WHEN:
        group, _, name = place.partition(".")
        assert set(keys) <= set(config_keys(import_target(options(group)[name].target))), (experiment, place)


@pytest.mark.parametrize("paper", ["ours", "literal"])
def test_the_torso_of_the_straight_walk_rotates_unless_as_published(paper):
    config = composed("experiment=walk_straight", f"paper={paper}")
    assert (config.prior.get("sigma_rotation") == [0.0, 0.0, 0.0]) == (paper == "literal")


LEARNED = ["walking", "gait", "cyclic", "activity", "implicit"]


@pytest.mark.parametrize("prior", LEARNED)
@pytest.mark.slow
def test_any_learned_prior_leaves_out_who_is_tracked(prior):
    config = composed("experiment=walk_multi_cue", f"prior={prior}").prior
    assert (config.motions, config.exclude) == ("recorded", ["35"])
    within = composed("experiment=walk_multi_cue", f"prior@prior.base={prior}", "prior=ar_offsets").prior.base
    assert (within.motions, within.exclude) == ("recorded", ["35"])
    own = composed("experiment=custom", f"prior={prior}").prior
    assert (own.motions, own.exclude) == ("recorded" if prior == "implicit" else "builtin", [])
    other = composed(
        "experiment=walk_multi_cue", f"prior={prior}", "training.motions=bandai", "prior.exclude=[x]"
    ).prior
    assert (other.motions, other.exclude) == ("bandai", ["x"])


@pytest.mark.parametrize(
    ("overrides", "motions"),
    [
        (["experiment=walk_video", "prior=cyclic"], "recorded"),
        (["experiment=ablation_inference", "dataset.motion=35_02", "prior=walking"], "recorded"),
        (["experiment=ablation_inference", "prior=walking"], "builtin"),
    ],
)
def test_recorded_people_are_followed_by_what_was_learned_from_recorded_people(overrides, motions):
    assert composed(*overrides).prior.motions == motions


def test_the_command_line_has_the_last_word_then_the_experiment_then_what_it_begins_with():
    chosen = ["experiment=coverage", "inference=gauss_newton"]
    assert composed(*chosen).inference.n_particles == 1400
    assert composed(*chosen, "inference.n_particles=7").inference.n_particles == 7
    assert composed("experiment=points_walk_variable").prior.n_components == 30
    assert composed("experiment=points_hybrid").prior.n_components == 8
    assert composed("experiment=balance_1cam").inference.problem is None  # so that nothing is measured in the truth
    assert composed("experiment=balance_1cam").likelihood.loss == "huber"


def test_nobody_whose_numbers_are_reported_is_one_to_choose_parameters_by():
    clips = composed("experiment=custom").clips
    chosen, reported = ({performer(name) for name in names} for names in (clips.validation, clips.test))
    assert None not in chosen | reported
    assert (len(chosen), len(reported)) == (len(clips.validation), len(clips.test))
    assert not chosen & reported
