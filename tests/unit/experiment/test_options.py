"""Parts of one's own: a package that a person names joins, and nothing else is ever imported."""

import importlib
import sys
from types import SimpleNamespace

import pytest
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

from workbench.cli.components import listing
from workbench.experiment.config import options as parts
from workbench.experiment.config.instantiate import build, check_targets
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import runnable_config
from workbench.recording.migrations import FORMAT
from workbench.utils.errors import InputError

MODULE = '''
"""A prior that holds still but for noise."""

from pathlib import Path

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.state_space import StateSpace

Path(__file__).with_name("imported").touch()


class Still:
    """Every parameter stays where it is, give or take.

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
OPTION = "_target_: my_components.mine.Still\n# A person who holds still.\n#   sigma: per second\nsigma: 0.25\n"
EXPERIMENT = """# @package _global_
# Holding still.
defaults: [walk_straight, override /prior: still]
if_chosen:
  prior.still: {sigma: 0.125}
  inference.particle_filter: {n_particles: 7}
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """The folder of a package my_components that can be imported and that nobody has named."""
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
    monkeypatch.setattr(parts, "_allowed", [])
    monkeypatch.delenv(parts.VARIABLE, raising=False)
    importlib.invalidate_caches()
    yield folder
    for known in (parts.folder, parts.folder_of):
        known.cache_clear()
    for name in [name for name in sys.modules if name.startswith("my_components")]:
        del sys.modules[name]


def composed(*overrides):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        return compose("config", overrides=["paths.data=null", *overrides])


def imported(package):
    return (package / "imported").exists()


def test_a_named_package_joins_the_groups_and_is_imported_when_chosen(package):
    parts.allow_packages(["my_components"])
    assert "still" in parts.options("prior")
    assert "A person who holds still [my_components]" in listing()
    composed("prior=smooth", "component_packages=[my_components]")
    assert not imported(package)
    config = composed("experiment=custom", "prior=still", "component_packages=[my_components]").prior
    assert imported(package)
    assert (config.sigma, config.names) == (0.25, [])
    check_targets(config)
    assert type(build(config)).__name__ == "Still"
    with pytest.raises(HydraException) as caught:
        composed("prior=still", "prior.sigmas=1")
    assert "sigmas" in str(caught.value)


def test_own_parts_go_within_ours_and_own_experiments_begin_with_ours(package):
    parts.allow_packages(["my_components"])
    assert composed("experiment=holding").prior.sigma == 0.125
    assert composed("experiment=holding").inference.n_particles == 7
    assert "sigma" not in composed("experiment=holding", "prior=implicit").prior
    assert composed("prior=ar_offsets", "prior@prior.base=still", "experiment=custom").prior.base.sigma == 0.25


def test_an_option_of_ones_own_is_checked_like_ours(package):
    parts.allow_packages(["my_components"])
    (package / "conf/prior/still.yaml").write_text(OPTION + "sigmas: 1\n")
    with pytest.raises(HydraException, match=r"still\.yaml: my_components\.mine\.Still has no key 'sigmas'"):
        composed("prior=still")
    (package / "conf/prior/smooth.yaml").write_text(OPTION)
    with pytest.raises(InputError, match=r"prior/smooth\.yaml: expected one file, found"):
        parts.options("prior")


def test_what_nobody_named_is_not_found_and_not_imported(package):
    assert "still" not in parts.options("prior")
    with pytest.raises(HydraException, match="still"):
        composed("prior=still")
    with pytest.raises(InputError, match=r"prior\._target_ .* found 'my_components\.mine\.Still'"):
        check_targets(OmegaConf.create({"prior": {"_target_": "my_components.mine.Still"}}))
    # a key that says so in a file, or in a configuration that is stored, names nothing
    with pytest.raises(InputError, match=r"if you trust its package, add component_packages=\[my_components\]"):
        check_targets(
            OmegaConf.create(
                {"component_packages": ["my_components"], "prior": {"_target_": "my_components.mine.Still"}}
            )
        )
    assert not imported(package)


def test_all_names_are_looked_at_before_any_is_imported(package):
    parts.allow_packages(["my_components"])
    both = OmegaConf.create({"prior": {"_target_": "my_components.mine.Still"}, "study": {"_target_": "os.system"}})
    with pytest.raises(InputError, match=r"study\._target_"):
        check_targets(both)
    assert not imported(package)
    with pytest.raises(InputError, match=r"my_components\.mine\.Path"):  # which it has, and somebody else wrote
        check_targets(OmegaConf.create({"prior": {"_target_": "my_components.mine.Path"}}))


def test_a_variable_and_an_entry_point_name_packages_too(package, monkeypatch):
    monkeypatch.setenv(parts.VARIABLE, "my_components")
    assert parts.packages() == ("workbench", "my_components")
    monkeypatch.delenv(parts.VARIABLE)
    assert parts.packages() == ("workbench",)
    parts._installed.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(parts, "entry_points", lambda group: [SimpleNamespace(value="my_components")])
        assert parts.packages() == ("workbench", "my_components")
    parts._installed.cache_clear()


def run_of(*, target):
    """The part of a recording that is checked before it is run again."""
    return SimpleNamespace(
        path="some/x.rrd",
        format=FORMAT,
        settings={"component_packages": ["my_components"], "prior": {"_target_": target}},
    )


def own():
    return OmegaConf.create({"paths": {"data": None, "cache": "/some/cache"}, "check": {}})


def test_a_recording_adds_nothing_to_what_may_be_built(package):
    words = (
        r"some/x\.rrd: prior\._target_: 'my_components\.mine\.Still' is no component of the workbench; "
        r"if you trust its package, add component_packages=\[my_components\]"
    )
    with pytest.raises(InputError, match=words):
        runnable_config(run_of(target="my_components.mine.Still"), [], own())
    assert not imported(package)
    parts.allow_packages(["my_components"])
    assert (
        runnable_config(run_of(target="my_components.mine.Still"), [], own()).prior._target_
        == "my_components.mine.Still"
    )
    with pytest.raises(InputError, match=r"'my_components\.mine\.Path' is no component of the workbench$"):
        runnable_config(run_of(target="my_components.mine.Path"), [], own())
    assert not imported(package)


@pytest.mark.parametrize(
    ("argument", "found"),
    [
        ("seed=3", []), ("component_packages=[my_components]", ["my_components"]), ("component_packages=[]", []),
        ("+component_packages=[a, b.c]", ["a", "b.c"]), ("component_packages=my_components", None),
        ("component_packages=[a],[b]", None), ("component_packages=", None), ("component_packages=[a;b]", None),
    ],
)  # fmt: skip
def test_packages_are_read_off_the_command_line(argument, found):
    if found is None:
        with pytest.raises(InputError, match="expected a list of packages"):
            parts.packages_in([argument])
    else:
        assert parts.packages_in([argument, "-m"]) == found


def test_a_package_that_is_not_there_or_has_no_options_is_refused(package):
    with pytest.raises(InputError, match="no package 'no_such_package'"):
        parts.allow_packages(["no_such_package"])
    with pytest.raises(InputError, match=r"expected options in .*conf"):
        parts.allow_packages(["email"])
    assert parts.packages() == ("workbench",)
