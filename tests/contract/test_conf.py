"""Every configuration composes, is typed, and builds from workbench targets only."""

from importlib.resources import files

import pytest
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cli.build import build, check_targets
from workbench.cli.run import prepare_hydra
from workbench.cli.schema import COMPONENTS, schema_of
from workbench.errors import InputError

CONF = files("workbench.conf")
GROUPS = sorted(folder.name for folder in CONF.iterdir() if folder.is_dir() and not folder.name.startswith("_"))
CHOICES = [
    (group, path.name.removesuffix(".yaml"))
    for group in GROUPS
    for path in sorted(CONF.joinpath(group).iterdir(), key=lambda path: path.name)
    if path.name.endswith(".yaml")
]


@pytest.fixture(autouse=True)
def hydra_is_ready():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        yield


@pytest.mark.parametrize(("group", "choice"), CHOICES)
def test_every_choice_composes_and_names_its_component(group, choice):
    usual = [] if group == "experiment" else ["experiment=custom"]  # an experiment's keys are those of its own choices
    config = compose("config", overrides=[*usual, f"{group}={choice}", "paths.data=somewhere"])
    if group != "experiment":
        assert config[group]["_target_"] == schema_of(COMPONENTS[group][choice])._target_
    chosen = [config[node] for node in COMPONENTS if config[node] is not None]
    assert chosen
    assert all(str(node["_target_"]).startswith("workbench.") for node in chosen)


@pytest.mark.parametrize("group", sorted(COMPONENTS))
def test_every_component_has_its_yaml(group):
    assert {choice for g, choice in CHOICES if g == group} == set(COMPONENTS[group])


@pytest.mark.parametrize("group", sorted(COMPONENTS))
def test_a_typo_in_any_group_names_the_key(group):
    usual = ["study=learn_walk"] if group == "study" else []  # the one group that is empty by default
    with pytest.raises(HydraException, match="no_such_key"):
        compose("config", overrides=[*usual, f"{group}.no_such_key=1"])
    forced = compose("config", overrides=[*usual, f"+{group}.no_such_key=1"])  # this skips the schema
    with pytest.raises(InputError, match="no_such_key"):
        build(forced[group])


def test_the_terms_of_a_product_are_built_with_the_live_objects():
    config = compose("config", overrides=["likelihood=product", "likelihood.terms.background.k=0.7"])
    body, dataset = person(from_height(1.7)), object()
    product = build(config.likelihood, body=body, dataset=dataset)
    assert list(product.terms) == list(product.weights) == [
        "image_motion", "background", "appearance", "edges", "silhouette",
    ]  # fmt: skip
    assert all(term.body is body for term in product.terms.values())
    assert product.terms["background"].dataset is dataset
    assert product.terms["background"].k == 0.7
    assert product.terms["edges"].cache == config.paths.cache  # interpolations keep their root


def test_rotation_is_fixed_for_the_builtin_walker_and_free_for_clips():
    assert compose("config").prior.sigma_rotation == [0.0, 0.0, 0.0]
    assert min(compose("config", overrides=["dataset.motion=35_02"]).prior.sigma_rotation) > 0.0


@pytest.mark.parametrize("experiment", ["learn_walk", "period_snr", "align_cycles", "impute_gaps"])
def test_a_study_takes_recorded_walks_where_there_are_any_and_nothing_to_track_with(experiment):
    config = compose("config", overrides=[f"experiment={experiment}", "paths.data=null"])
    assert {group for group in COMPONENTS if config[group] is not None} == {"study"}
    assert config.study.motions == "builtin"
    config = compose("config", overrides=[f"experiment={experiment}", "paths.data=somewhere"])
    assert (config.study.motions, config.study.data) == ("cmu", "somewhere")


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "workbench",
        "workbench.",
        "workbench.cli.run.os",
        "workbench.cli.run.hydra",
        "workbenchx.y",
        3,
        None,
    ],
)
def test_only_targets_of_the_workbench_pass(target):
    with pytest.raises(InputError, match=r"a\.b\[0\]\._target_"):
        check_targets(OmegaConf.create({"a": {"b": [{"_target_": target}]}}))
    check_targets(OmegaConf.create({"a": {"_target_": "workbench.priors.from_motions.walking"}}))
