"""The condition that ends a run: a number, a sign, a bound, and nothing else."""

import pytest

from workbench.sweep.early_stop import stop_when
from workbench.utils.errors import InputError


@pytest.mark.parametrize(
    ("text", "metrics", "holds"),
    [
        ("times_lost>0", {"times_lost": 1.0}, True),
        ("times_lost>0", {"times_lost": 0.0}, False),
        ("times_lost>0", {}, False),
        ("error_px >= 4.5", {"error_px": 4.5}, True),
        ("error_px<=4", {"error_px": 4.5}, False),
        ("ess<1e1", {"ess": 9.0}, True),
        ("held=0", {"held": 0.0}, True),
        ("error_px>4", {"error_px": float("nan")}, False),
    ],
)
def test_it_compares_a_number_of_the_run(text, metrics, holds):
    assert stop_when(text)(metrics) is holds


@pytest.mark.parametrize(
    "text", ["times_lost", "times_lost>", ">0", "a>b", "__import__('os')>0", "a>0 or b>0", "", "a>nan", "a<1e999"]
)
def test_anything_else_is_a_sentence(text):
    with pytest.raises(InputError, match=r"sweep\.stop_when"):
        stop_when(text)
