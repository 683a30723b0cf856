"""References of a configuration to its own parts, which a few lines can make stand for more than any memory holds."""

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import InterpolationResolutionError

from workbench.experiment.references import bound_references
from workbench.limits import MOST_REFERENCES


@pytest.fixture(autouse=True)
def _bounded():
    bound_references()
    bound_references()  # which counts nothing twice


def chain(n_levels, each):
    """A configuration in which every value refers so many times to the one before."""
    return OmegaConf.create({"a0": "x", **{f"a{k + 1}": f"${{a{k}}}" * each for k in range(n_levels)}})


def test_what_refers_to_what_refers_to_others_is_refused():
    for resolve in (lambda config: config.a9, lambda config: OmegaConf.to_container(config, resolve=True)):
        with pytest.raises(InterpolationResolutionError, match=f"at most {MOST_REFERENCES} references in one"):
            resolve(chain(9, 20))


def test_what_is_usual_goes_on_and_every_value_is_counted_by_itself():
    assert chain(5, 2).a5 == "x" * 32
    assert chain(9, 1).a9 == "x"
    many = OmegaConf.create({"a": "x", "b": ["${a}"] * (3 * MOST_REFERENCES)})
    assert OmegaConf.to_container(many, resolve=True)["b"] == ["x"] * (3 * MOST_REFERENCES)
