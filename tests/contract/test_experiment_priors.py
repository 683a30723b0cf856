"""An experiment accepts any prior, likelihood and inference, and sets only keys of its own choices."""

import pytest
from compositions import composed
from omegaconf import OmegaConf

from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import options
from workbench.motion.formats.names import performer


def test_conditional_settings_of_an_experiment_are_keys_of_their_component():
    """Hydra rejects other keys, but only when the component is chosen."""
    if_chosen = [
        (experiment, place, keys)
        for experiment, option in sorted(options("experiment").items())
        for settings in [OmegaConf.create(option.text).get("if_chosen") or {}]
        for place, keys in [*settings.items(), *settings.get("paper.literal", {}).items()]
        if place not in ("paper.literal", "study")
    ]
    assert if_chosen
    for experiment, place, keys in if_chosen:
        group, _, name = place.partition(".")
        assert set(keys) <= set(config_keys(import_target(options(group)[name].target))), (experiment, place)


@pytest.mark.parametrize("paper", ["ours", "literal"])
def test_only_the_published_straight_walk_has_a_fixed_torso_orientation(paper):
    config = composed("experiment=walk_straight", f"paper={paper}")
    assert (config.prior.get("sigma_rotation") == [0.0, 0.0, 0.0]) == (paper == "literal")


LEARNED = ["walking", "gait", "cyclic", "activity", "implicit"]


@pytest.mark.parametrize("prior", LEARNED)
@pytest.mark.slow
def test_any_learned_prior_excludes_the_tracked_person(prior):
    config = composed("experiment=walk_multi_cue", f"prior={prior}").prior
    assert (config.motions, config.exclude) == ("recorded", ["35"])
    base = composed("experiment=walk_multi_cue", f"prior@prior.base={prior}", "prior=ar_offsets").prior.base
    assert (base.motions, base.exclude) == ("recorded", ["35"])
    builtin = composed("experiment=custom", f"prior={prior}").prior
    assert (builtin.motions, builtin.exclude) == ("recorded" if prior == "implicit" else "builtin", [])
    overridden = composed(
        "experiment=walk_multi_cue", f"prior={prior}", "training.motions=bandai", "prior.exclude=[x]"
    ).prior
    assert (overridden.motions, overridden.exclude) == ("bandai", ["x"])


@pytest.mark.parametrize(
    ("overrides", "motions"),
    [
        (["experiment=walk_video", "prior=cyclic"], "recorded"),
        (["experiment=ablation_inference", "dataset.motion=35_02", "prior=walking"], "recorded"),
        (["experiment=ablation_inference", "prior=walking"], "builtin"),
    ],
)
def test_recorded_people_are_tracked_with_models_of_recorded_people(overrides, motions):
    assert composed(*overrides).prior.motions == motions


def test_the_command_line_overrides_the_experiment():
    overrides = ["experiment=coverage", "inference=gauss_newton"]
    assert composed(*overrides).inference.n_particles == 1400
    assert composed(*overrides, "inference.n_particles=7").inference.n_particles == 7


def test_validation_and_test_people_are_disjoint():
    clips = composed("experiment=custom").clips
    validation, test = ({performer(name) for name in names} for names in (clips.validation, clips.test))
    assert None not in validation | test
    assert (len(validation), len(test)) == (len(clips.validation), len(clips.test))
    assert not validation & test
