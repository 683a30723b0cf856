"""Arguments that Hydra's grammar does not take are quoted; what may be meant otherwise is not."""

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.cli.hydra_quoting import quoted


def value_of(argument):
    return OverridesParser.create().parse_override(argument).value()


SIGNS = st.characters(codec="utf-8", exclude_categories=("Cc", "Zl", "Zp"), exclude_characters="\\")


@settings(max_examples=25)
@given(st.text(SIGNS, min_size=1))
def test_any_name_of_a_folder_reaches_hydra_as_it_is(name):
    if "${" not in name:
        assert value_of(quoted(f"hydra.run.dir=runs/{name}/x")) == f"runs/{name}/x"


@pytest.mark.parametrize("value", ["times_lost>0", "Läufe/日本.bvh", "a#b", "<3"])
def test_what_can_be_meant_in_one_way_only_is_quoted(value):
    assert quoted(f"any.key={value}") == f"any.key='{value}'"


@pytest.mark.parametrize(
    "argument",
    ["sweep.stop_when='times_lost>0'", "seed=1,2", "seed=range(5)", "seed=[1", "x={a: ü}", "prior=a,ü", "x=a b", "x=",
     "hydra.run.dir='Läufe'", "hydra.run.dir=${now:%Y}", "-m", "--cfg=job", "from"],
)  # fmt: skip
def test_the_rest_stays_as_it_is(argument):
    assert quoted(argument) == argument
