"""Every option composes, is typed by the class that it names on line 1, and says only where it departs from it."""

import inspect

import pytest
import yaml
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.experiment.config.instantiate import build, check_targets, keys_of, resolved
from workbench.experiment.config.options import GROUPS, options
from workbench.experiment.config.schema import ComponentSource, prepare_hydra, typed
from workbench.utils.errors import InputError

CHOICES = [(group, option) for group in GROUPS for option in options(group)]


@pytest.fixture(autouse=True)
def hydra_is_ready():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        yield


def test_every_option_names_its_class_on_line_1_and_notes_keys_of_it():
    for option in [options(group)[choice] for group, choice in CHOICES]:
        assert option.about
        assert set(option.notes) <= set(keys_of(resolved(option.target))), option


def test_no_default_stands_twice():
    """A YAML file repeats no default of its classes."""
    for option in [options(group)[choice] for group, choice in CHOICES] + list(options("experiment").values()):
        for node in _with_target(yaml.safe_load(option.text)):
            keys = keys_of(resolved(node["_target_"]))
            own = {key: value for key, value in node.items() if key not in ("_target_", "defaults")}
            assert [key for key, value in own.items() if value == _plain(keys[key][1])] == [], option


def _with_target(value):
    if isinstance(value, dict):
        yield from [value] if "_target_" in value else []
        for item in value.values():
            yield from _with_target(item)


def _plain(default):
    return list(default) if isinstance(default, tuple) else default


def test_nothing_but_options_is_listed():
    source = ComponentSource("main", "parts://workbench")
    assert source.list("", None) == sorted(["config", "experiment", "paper", *(set(GROUPS) - {"study"})])
    for group in ("experiment", *GROUPS):
        assert source.list(group, None) == sorted(options(group))


@pytest.mark.parametrize("group", GROUPS)
def test_a_typo_in_any_group_names_the_key(group):
    usual = ["experiment=learn_walk"] if group == "study" else []  # the one group that is empty by default
    with pytest.raises(HydraException, match="no_such_key"):
        compose("config", overrides=[*usual, f"{group}.no_such_key=1"])
    forced = compose("config", overrides=[*usual, f"+{group}.no_such_key=1"])  # this skips the schema
    with pytest.raises(InputError, match="no_such_key"):
        build(forced[group])


@pytest.mark.parametrize(
    ("override", "match"),
    [
        ("likelihood.terms.background.no_such_key=1", "no_such_key"),
        ("likelihood.terms.background.k=many", "many"),
        ("prior.base.no_such_key=1", "no_such_key"),
        ("learn.no_such_key=1", "no_such_key"),
        ("when=walk_best", "when"),
        ("prior=no_such_prior", "no_such_prior"),
    ],
)
def test_typos_within_parts_and_at_the_top_are_named_too(override, match):
    with pytest.raises(HydraException) as caught:
        compose("config", overrides=["experiment=walk_best", override])
    assert match in f"{caught.value} {caught.value.__cause__}"


def test_keys_that_only_the_class_lists_can_be_overridden():
    config = compose("config", overrides=["dataset.person_px=80", "prior.sigma_phase=0.5"])
    assert (config.dataset.person_px, config.prior.sigma_phase) == (80.0, 0.5)


@pytest.mark.parametrize("override", ["prior.sigma_velocity={elbow: 4.0}", "+prior.sigma_velocity.elbow=4.0"])
def test_numbers_by_name_can_be_given_where_there_are_none(override):
    assert (
        compose("config", overrides=["experiment=custom", "prior=smooth", override]).prior.sigma_velocity.elbow == 4.0
    )


@pytest.mark.parametrize("plus", ["", "+"])
def test_files_by_camera_are_given_without_a_plus_and_with_one(plus):
    files = [f"{plus}dataset.sources={{a: a.mp4, b: b.mp4}}", f"{plus}dataset.keypoints={{a: a.csv}}"]
    config = compose("config", overrides=["experiment=custom", "dataset=multi_view", "dataset.camera=c.toml", *files])
    assert (config.dataset.sources, config.dataset.keypoints) == ({"a": "a.mp4", "b": "b.mp4"}, {"a": "a.csv"})


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("_target_: workbench.priors.ar_offsets.Jitter\nsigmas: 1", "mine.yaml.*Jitter has no key 'sigmas'"),
        ("_target_: workbench.priors.ar_offsets.Jitter\nsigma: much", "mine.yaml.*much.*sigma"),
        ("base: {_target_: workbench.priors.smooth.Smooth, k: 1}", "mine.yaml.*Smooth.*'k'"),
        ("_target_: workbench.priors.ar_offsets.Nobody", "mine.yaml.*Nobody"),
        ("_target_: os.system", "mine.yaml.*os.system"),
    ],
)  # fmt: skip
def test_a_file_with_a_key_that_is_none_is_named(text, match):
    with pytest.raises(HydraException, match=match):
        typed(OmegaConf.to_container(OmegaConf.create(text)), "conf/prior/mine.yaml")


def test_parts_within_a_file_have_the_keys_of_their_classes():
    text = "_target_: workbench.priors.ar_offsets.Jitter\nbase: {_target_: workbench.priors.smooth.Smooth, damping: 1}"
    found = typed(OmegaConf.to_container(OmegaConf.create(text)), "mine.yaml")
    assert (found.base.damping, found.base.start_pose, found.keep) == (1.0, 2.0, 0.9)


def test_what_a_run_fills_in_is_no_key():
    assert set(keys_of(resolved("workbench.priors.ar_offsets.Jitter"))) == {"base", "sigma", "keep", "parameters"}
    for group, choice in CHOICES:
        assert not {"body", "prior", "likelihood", "run_id"} & set(keys_of(resolved(options(group)[choice].target)))


def test_the_terms_of_a_product_are_built_with_the_live_objects():
    config = compose("config", overrides=["likelihood=product", "likelihood.terms.background.k=0.7"])
    body, clip = person(from_height(1.7)), object()
    product = build(config.likelihood, body=body, clip=clip)
    assert list(product.terms) == list(product.weights) == [
        "image_motion", "background", "appearance", "edges", "silhouette",
    ]  # fmt: skip
    assert all(term.body is body for term in product.terms.values())
    assert product.terms["background"].clip is clip
    assert product.terms["background"].k == 0.7
    assert product.terms["edges"].cache == config.paths.cache  # interpolations keep their root


@pytest.mark.parametrize(
    "target", ["os.system", "workbench", "workbench.", "workbench.cli.run.os", "workbench.cli.run.hydra", 3, None]
)
def test_only_targets_of_the_workbench_pass(target):
    with pytest.raises(InputError, match=r"a\.b\[0\]\._target_"):
        check_targets(OmegaConf.create({"a": {"b": [{"_target_": target}]}}))
    check_targets(OmegaConf.create({"a": {"_target_": "workbench.priors.from_motions.walking"}}))


def test_what_a_module_of_ours_only_imports_is_no_part(monkeypatch):
    """Though an option names it."""
    target = "workbench.experiment.config.instantiate.import_module"
    monkeypatch.setattr("workbench.experiment.config.instantiate.targets", lambda: {target})
    with pytest.raises(InputError, match="must name a part"):
        resolved(target)


def test_no_signature_hides_its_parameters():
    for group, choice in CHOICES:
        kinds = {each.kind for each in inspect.signature(resolved(options(group)[choice].target)).parameters.values()}
        assert not kinds & {inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL}, choice
