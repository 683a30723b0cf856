"""Options are typed by the class on line 1, list only changed defaults, and compose to a paper's configuration."""

import inspect
import re

import pytest
import yaml
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.experiment.config.instantiate import build, check_targets, config_keys, import_target
from workbench.experiment.config.options import GROUPS, Option, options
from workbench.experiment.config.schema import composed as composed_now
from workbench.experiment.config.schema import prepare_hydra, typed
from workbench.utils.errors import InputError

CHOICES = [(group, option) for group in GROUPS for option in options(group)]


@pytest.fixture(autouse=True)
def hydra_is_ready():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        yield


def test_every_option_names_its_class_and_describes_only_its_keys():
    for option in [options(group)[choice] for group, choice in CHOICES]:
        assert option.about
        assert {key.partition(".")[0] for key in option.notes} <= set(config_keys(import_target(option.target))), option


def test_every_key_has_a_description():
    for option in [options(group)[choice] for group, choice in CHOICES if group != "study"]:
        target = import_target(option.target)
        described = {
            name for names in re.findall(r"([\w, ]+) ?: ", inspect.getdoc(target) or "") for name in names.split(", ")
        }
        assert {*config_keys(target)} <= {*option.all_notes, *(name.strip() for name in described)}, option


def test_notes_may_continue_and_apply_to_several_keys():
    text = "_target_: a.B\n# About.\n#   one, two: first\n#     second\n#   one.key: third\nthree: 3 # fourth\n"
    option = Option("a", "prior", "b", text)
    assert option.about == "About"
    assert option.notes == {"one": "first second", "two": "first second", "one.key": "third", "three": "fourth"}
    walk, balance = options("dataset")["video"], options("dataset")["sports2d_walk"]
    assert balance.notes == {}
    assert walk.notes.items() <= balance.all_notes.items()


def test_no_option_repeats_a_default():
    """A YAML file lists only values that differ from the defaults of its classes."""
    for option in [options(group)[choice] for group, choice in CHOICES] + list(options("experiment").values()):
        for node in _with_target(yaml.safe_load(option.text)):
            keys = config_keys(import_target(node["_target_"]))
            values = {key: value for key, value in node.items() if key not in ("_target_", "defaults")}
            assert [key for key, value in values.items() if value == _plain(keys[key][1])] == [], option


def _with_target(value):
    if isinstance(value, dict):
        yield from [value] if "_target_" in value else []
        for item in value.values():
            yield from _with_target(item)


def _plain(default):
    return list(default) if isinstance(default, tuple) else default


@pytest.mark.parametrize(
    ("override", "match"),
    [
        ("likelihood.terms.background.no_such_key=1", "no_such_key"),
        ("likelihood.terms.background.effective_pixels=many", "many"),
        ("prior.base.no_such_key=1", "no_such_key"),
        ("training.no_such_key=1", "no_such_key"),
        ("if_chosen=walk_multi_cue", "if_chosen"),
        ("prior=no_such_prior", "no_such_prior"),
    ],
)
def test_a_typo_in_a_nested_or_top_level_key_is_named(override, match):
    with pytest.raises(HydraException) as error:
        compose("config", overrides=["experiment=walk_multi_cue", override])
    assert match in f"{error.value} {error.value.__cause__}"


@pytest.mark.parametrize("plus", ["", "+"])
def test_empty_mappings_are_filled_with_and_without_a_plus(plus):
    files = [f"{plus}dataset.sources={{a: a.mp4, b: b.mp4}}", f"{plus}dataset.keypoints={{a: a.csv}}"]
    files += ["+prior.sigma_velocity.elbow=4.0" if plus else "prior.sigma_velocity={elbow: 4.0}"]
    overrides = ["experiment=custom", "dataset=multi_view", "dataset.calibration_file=c.toml", "prior=smooth", *files]
    config = compose("config", overrides=overrides)
    assert (config.dataset.sources, config.dataset.keypoints) == ({"a": "a.mp4", "b": "b.mp4"}, {"a": "a.csv"})
    assert config.prior.sigma_velocity.elbow == 4.0


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("_target_: workbench.priors.ar_offsets.AROffsets\nsigmas: 1", "mine.yaml.*AROffsets has no key 'sigmas'"),
        ("_target_: workbench.priors.ar_offsets.AROffsets\nsigma: much", "mine.yaml.*much.*sigma"),
        ("base: {_target_: workbench.priors.smooth.Smooth, k: 1}", "mine.yaml.*Smooth.*'k'"),
        ("_target_: workbench.priors.ar_offsets.Nobody", "mine.yaml.*Nobody"),
        ("_target_: os.system", "mine.yaml.*os.system"),
    ],
)  # fmt: skip
def test_an_unknown_key_or_target_is_rejected_with_its_file(text, match):
    with pytest.raises(HydraException, match=match):
        typed(OmegaConf.to_container(OmegaConf.create(text)), "conf/prior/mine.yaml")


def test_the_terms_of_a_product_get_the_runs_objects():
    config = compose("config", overrides=["likelihood=product", "likelihood.terms.background.effective_pixels=0.7"])
    body, clip = person(from_height(1.7)), object()
    product = build(config.likelihood, body=body, clip=clip)
    assert list(product.terms) == list(product.weights) == [
        "image_motion", "background", "appearance", "edges", "silhouette",
    ]  # fmt: skip
    assert all(term.body is body for term in product.terms.values())
    assert product.terms["background"].clip is clip
    assert product.terms["background"].effective_pixels == 0.7
    assert product.terms["edges"].cache == config.paths.cache  # interpolations are resolved


@pytest.mark.parametrize(
    "target", ["os.system", "workbench", "workbench.", "workbench.cli.run.os", "workbench.cli.run.hydra", 3, None]
)
def test_only_components_of_the_workbench_are_accepted(target):
    with pytest.raises(InputError, match=r"a\.b\[0\]\._target_"):
        check_targets(OmegaConf.create({"a": {"b": [{"_target_": target}]}}))
    check_targets(OmegaConf.create({"a": {"_target_": "workbench.priors.from_motions.walking"}}))


def test_a_name_that_a_module_only_imports_is_not_a_component(monkeypatch):
    target = "workbench.experiment.config.instantiate.import_module"
    monkeypatch.setattr("workbench.experiment.config.instantiate.is_target", lambda name: name == target)
    with pytest.raises(InputError, match="expected a component of the workbench"):
        import_target(target)


def literal_of(option):
    return ((yaml.safe_load(option.text) or {}).get("if_chosen") or {}).get("paper.literal")


EXPERIMENTS = options("experiment")
OF_PAPERS = sorted(name for name, option in EXPERIMENTS.items() if literal_of(option) is not None)
UNCHANGED = {"learn_walk_run", "impute_gaps"}
"""Experiments whose default configuration is the published one."""


def leaves(value, place=""):
    """Return the values of a mapping with their keys, without interpolations."""
    if isinstance(value, dict):
        return {leaf for key, item in value.items() for leaf in leaves(item, f"{place}.{key}")}
    return set() if "${" in str(value) else {(place, str(value))}


def composed(*overrides):
    return OmegaConf.to_container(compose("config", overrides=["paths.data=somewhere", *overrides]), resolve=True)


@pytest.mark.parametrize("experiment", OF_PAPERS)
@pytest.mark.slow
def test_a_papers_experiment_composes_to_the_published_values(experiment):
    """All values of `paper.literal` are set; without any, the default configuration is the published one."""
    literal = composed(f"experiment={experiment}", "paper=literal")
    assert literal.pop("paper") == "literal"
    for place, keys in literal_of(EXPERIMENTS[experiment]).items():
        group, _, option = place.partition(".")
        if not option or literal[group]["_target_"] == options(group)[option].target:
            assert leaves(keys) <= leaves(literal[group]), place
    if experiment in UNCHANGED:
        ours = composed(f"experiment={experiment}")
        assert ours.pop("paper") == "ours"
        assert ours == literal


@pytest.mark.parametrize("experiment", ["walk_multi_cue", "coverage", "custom"])
def test_paper_literal_is_rejected_for_an_experiment_of_no_paper(experiment):
    with pytest.raises(HydraException, match=f"paper=literal: experiment={experiment} is in none of the papers"):
        composed(f"experiment={experiment}", "paper=literal")


def test_the_command_line_overrides_the_paper():
    config = composed("experiment=walk_straight", "paper=literal", "likelihood.reduction=mean", "prior.n_components=3")
    assert (config["likelihood"]["reduction"], config["likelihood"]["occlusion"]) == ("mean", "limb")
    assert (config["prior"]["n_components"], config["prior"]["transition"]) == (3, "A")


def test_a_prior_chosen_on_the_command_line_has_its_published_values():
    prior = composed("experiment=arm_smooth_300", "prior=implicit", "paper=literal")["prior"]
    assert (prior["search"], prior["prediction"], prior["beta"]) == ("sign_tree", "copy", 0.05)


@pytest.mark.parametrize(("group", "option"), CHOICES)
def test_a_component_has_the_runs_seed_unless_it_sets_its_own(group, option):
    if "seed" in config_keys(import_target(options(group)[option].target)):
        for overrides, seed in (((), 3), ((f"{group}.seed=1",), 1)):
            config = compose("config", overrides=["experiment=custom", f"{group}={option}", "seed=3", *overrides])
            assert config[group].seed == seed


@pytest.mark.parametrize("override", ["prior.sigma=0.05", "prior.penalty=[1]"])
def test_values_of_another_type_than_the_parameter_are_refused(override):
    with pytest.raises(InputError, match=rf"smooth\.Smooth: {override[6:].partition('=')[0]}.*: expected .*found"):
        build(composed_now(["prior=smooth", override]).prior)


@pytest.mark.parametrize("height", ["nan", "inf", "1e10"])
def test_numbers_out_of_bounds_are_refused_by_every_command(height):
    with pytest.raises(InputError, match=r"body\.height_m: expected a number"):
        composed_now(["body=height", f"body.height_m={height}"])
