"""A user's own components: options of a named package are available, and no other package is imported."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

from workbench.cli.components import listing
from workbench.experiment.config import options as options_module
from workbench.experiment.config.instantiate import build, check_targets, config_keys, import_target
from workbench.experiment.config.options import GROUPS
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import runnable_config
from workbench.utils.errors import InputError

MODULE = '''
"""A random-walk prior."""

from pathlib import Path

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.state_space import StateSpace

Path(__file__).with_name("imported").touch()


class Still:
    """A random walk of every parameter.

    sigma: noise per second.
    """

    def __init__(self, *, sigma: float = 0.5, names: tuple[str, ...] = ()) -> None:
        self.sigma, self.parameters = sigma, POSE_NAMES
        self.space = StateSpace.of({"pose": (POSE_NAMES, "rad")})

    def start(self, pose, n, rng):
        return pose + self.sigma * rng.standard_normal((n, len(pose)))

    def step(self, state, dt_s, rng):
        return state + self.sigma * np.sqrt(dt_s) * rng.standard_normal(state.shape)

    def pose(self, state):
        return state
'''
OPTION = "_target_: my_components.mine.Still\n# A random-walk prior.\n#   sigma: per second\nsigma: 0.25\n"
EXPERIMENT = """# @package _global_
# A walk with the random-walk prior.
defaults: [walk_straight, override /prior: still]
if_chosen:
  prior.still: {sigma: 0.125}
  inference.particle_filter: {n_particles: 7}
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return the folder of an importable package my_components that is not yet allowed."""
    folder = tmp_path / "my_components"
    for name, text in {
        "__init__.py": "",
        "mine.py": MODULE,
        "conf/prior/still.yaml": OPTION,
        "conf/experiment/holding.yaml": EXPERIMENT,
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(options_module, "_allowed", [])
    monkeypatch.delenv(options_module.VARIABLE, raising=False)
    importlib.invalidate_caches()
    yield folder
    for function in (options_module.folder, options_module.folder_of):
        function.cache_clear()
    for name in [name for name in sys.modules if name.startswith("my_components")]:
        del sys.modules[name]


def composed(*overrides):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        return compose("config", overrides=["paths.data=null", *overrides])


def imported(package):
    return (package / "imported").exists()


def test_a_named_package_adds_its_options_and_is_imported_when_chosen(package):
    options_module.allow_packages(["my_components"])
    assert "still" in options_module.options("prior")
    assert "A random-walk prior [my_components]" in listing()
    composed("prior=smooth", "component_packages=[my_components]")
    assert not imported(package)
    config = composed("experiment=custom", "prior=still", "component_packages=[my_components]").prior
    assert imported(package)
    assert (config.sigma, config.names) == (0.25, [])
    check_targets(config)
    assert type(build(config)).__name__ == "Still"
    with pytest.raises(HydraException) as error:
        composed("prior=still", "prior.sigmas=1")
    assert "sigmas" in str(error.value)


def test_an_own_option_is_checked_against_its_class(package):
    options_module.allow_packages(["my_components"])
    (package / "conf/prior/still.yaml").write_text(OPTION + "sigmas: 1\n")
    with pytest.raises(HydraException, match=r"still\.yaml: my_components\.mine\.Still has no key 'sigmas'"):
        composed("prior=still")
    (package / "conf/prior/smooth.yaml").write_text(OPTION)
    with pytest.raises(InputError, match=r"prior/smooth\.yaml: expected one file, found"):
        options_module.options("prior")


def test_an_unnamed_package_is_rejected_and_not_imported(package):
    assert "still" not in options_module.options("prior")
    with pytest.raises(HydraException, match="still"):
        composed("prior=still")
    with pytest.raises(InputError, match=r"prior\._target_ .* found 'my_components\.mine\.Still'"):
        check_targets(OmegaConf.create({"prior": {"_target_": "my_components.mine.Still"}}))
    # component_packages in a file or in a stored configuration has no effect
    with pytest.raises(InputError, match=r"if you trust its package, add component_packages=\[my_components\]"):
        check_targets(
            OmegaConf.create(
                {"component_packages": ["my_components"], "prior": {"_target_": "my_components.mine.Still"}}
            )
        )
    assert not imported(package)


def test_all_targets_are_checked_before_any_is_imported(package):
    options_module.allow_packages(["my_components"])
    both = OmegaConf.create({"prior": {"_target_": "my_components.mine.Still"}, "study": {"_target_": "os.system"}})
    with pytest.raises(InputError, match=r"study\._target_"):
        check_targets(both)
    assert not imported(package)
    with pytest.raises(InputError, match=r"my_components\.mine\.Path"):  # imported by the module, but not defined in it
        check_targets(OmegaConf.create({"prior": {"_target_": "my_components.mine.Path"}}))


def test_a_variable_and_an_entry_point_can_name_packages(package, monkeypatch):
    monkeypatch.setenv(options_module.VARIABLE, "my_components")
    assert options_module.packages() == ("workbench", "my_components")
    monkeypatch.delenv(options_module.VARIABLE)
    assert options_module.packages() == ("workbench",)
    options_module._installed.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(options_module, "entry_points", lambda group: [SimpleNamespace(value="my_components")])
        assert options_module.packages() == ("workbench", "my_components")
    options_module._installed.cache_clear()


def run_of(*, target):
    """Return the part of a recording that is checked before it is repeated."""
    return SimpleNamespace(
        path=Path("some/x.rrd"), settings={"component_packages": ["my_components"], "prior": {"_target_": target}}
    )


def defaults():
    return OmegaConf.create({"paths": {"data": None, "cache": "/some/cache"}, "check": {}})


def test_a_recording_cannot_allow_packages(package):
    message = (
        r"some/x\.rrd: prior\._target_: 'my_components\.mine\.Still' is no component of the workbench; "
        r"if you trust its package, add component_packages=\[my_components\]"
    )
    with pytest.raises(InputError, match=message):
        runnable_config(run_of(target="my_components.mine.Still"), [], defaults())
    assert not imported(package)
    options_module.allow_packages(["my_components"])
    with pytest.raises(InputError, match=r"'my_components\.mine\.Path' is no component of the workbench$"):
        runnable_config(run_of(target="my_components.mine.Path"), [], defaults())
    assert not imported(package)
    config = runnable_config(run_of(target="my_components.mine.Still"), [], defaults())
    assert config.prior._target_ == "my_components.mine.Still"


@pytest.mark.parametrize(
    ("argument", "packages"),
    [
        ("seed=3", []), ("component_packages=[my_components]", ["my_components"]), ("component_packages=[]", []),
        ("+component_packages=[a, b.c]", ["a", "b.c"]), ("component_packages=my_components", None),
        ("component_packages=[a],[b]", None), ("component_packages=", None), ("component_packages=[a;b]", None),
    ],
)  # fmt: skip
def test_packages_are_parsed_from_the_command_line(argument, packages):
    if packages is None:
        with pytest.raises(InputError, match="expected a list of packages"):
            options_module.packages_in([argument])
    else:
        assert options_module.packages_in([argument, "-m"]) == packages


def test_a_missing_package_and_one_without_options_are_rejected(package):
    with pytest.raises(InputError, match="no package 'no_such_package'"):
        options_module.allow_packages(["no_such_package"])
    with pytest.raises(InputError, match=r"expected options in .*conf"):
        options_module.allow_packages(["email"])
    assert options_module.packages() == ("workbench",)


def test_components_with_a_cache_use_the_configured_folder():
    for option in (option for group in GROUPS for option in options_module.options(group).values()):
        node = OmegaConf.create(option.text)
        if "_target_" in node and "cache" in config_keys(import_target(node._target_)):
            assert OmegaConf.to_container(node).get("cache") == "${paths.cache}", option
