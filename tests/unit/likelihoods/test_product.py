"""The product of likelihoods: powers, shares, memory, and how a configuration builds one."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from workbench.errors import InputError
from workbench.likelihoods.likelihood import diagnostics, remember
from workbench.likelihoods.product import Product, shares
from workbench.likelihoods.uniform import Uniform

FRAME = scenes.frame(0, (scenes.FRONT, scenes.flat(0)))
POSES = np.zeros((4, 25))


class Fixed:
    """Says the same of any poses, and keeps what it is told."""

    def __init__(self, *log_prob, told=()):
        self.values, self.told, self.seen = np.array(log_prob, dtype=float), list(told), []

    def log_prob(self, previous, frame, previous_pose, pose):
        return self.values

    def warnings(self):
        told, self.told = tuple(self.told), []
        return told

    def begin(self, frame, pose):
        self.seen = ["began"]

    def observe(self, frame, pose):
        self.seen.append("observed")

    def diagnostics(self):
        return {"found": 3.0}


def evaluate(product):
    return product.log_prob(FRAME, FRAME, POSES, POSES)


def test_weights_are_powers():
    product = Product({"a": Fixed(0, 1, 2, 3), "b": Fixed(4, 0, 0, 4)}, {"a": 0.5, "b": 2.0})
    np.testing.assert_array_equal(evaluate(product), [8.0, 0.5, 1.0, 9.5])


def test_a_term_without_weight_is_never_asked():
    product = Product({"a": Fixed(0, 1, 2, 3), "off": Fixed(np.nan, np.nan, np.nan, np.nan)}, {"a": 1.0, "off": 0.0})
    np.testing.assert_array_equal(evaluate(product), [0.0, 1.0, 2.0, 3.0])
    assert set(product.diagnostics()) == {"found", "share_a"}
    remember(product, FRAME, POSES[0], first=True)
    assert product.terms["off"].seen == []


def test_without_any_weight_every_pose_is_equally_likely():
    product = Product({"a": Fixed(0, 1, 2, 3)}, {"a": 0.0})
    np.testing.assert_array_equal(evaluate(product), np.zeros(4))
    assert product.diagnostics() == {}


def test_shares_sum_to_one_and_a_cue_that_contradicts_is_negative():
    a, b = np.array([0.0, 3.0, 6.0, 9.0]), np.array([3.0, 2.0, 1.0, 0.0])
    found = shares({"a": a, "b": b}, a + b)
    assert found == pytest.approx({"a": 1.5, "b": -0.5})  # b is −a/3 and a constant
    impossible = np.array([-np.inf, 0.0, 0.0, 0.0])
    found = shares({"a": a, "b": b + impossible}, a + b + impossible)
    assert found == pytest.approx({"a": 1.5, "b": -0.5})
    assert shares({"a": np.ones(4)}, np.ones(4)) == {"a": 0.0}


def test_every_term_is_told_what_was_found_and_warns():
    product = Product({"a": Fixed(0, 0, 0, 0, told=["careful"]), "b": Uniform()}, {"a": 1.0, "b": 1.0})
    remember(product, FRAME, POSES[0], first=True)
    remember(product, FRAME, POSES[0], first=False)
    assert product.terms["a"].seen == ["began", "observed"]
    assert product.diagnostics() == {"found": 3.0, "share_a": 0.0, "share_b": 0.0}
    assert product.warnings() == ("careful",)
    evaluate(product)
    assert diagnostics(product) == {"found": 3.0, "share_a": 0.0, "share_b": 0.0}
    assert diagnostics(Uniform()) == {}


@pytest.mark.parametrize(
    ("terms", "weights", "said"),
    [
        ({}, {}, "needs at least one term"),
        ({"a": Uniform()}, {"b": 1.0}, "weights must be given for a, found b"),
        ({"a": Uniform()}, {}, "weights must be given for a, found none"),
        ({"a": Uniform()}, {"a": -1.0}, "the weight of a must be at least 0, found -1.0"),
        ({"a": Uniform()}, {"a": float("nan")}, "the weight of a must be at least 0, found nan"),
    ],
)
def test_a_product_that_makes_no_sense(terms, weights, said):
    with pytest.raises(InputError, match=said):
        Product(terms, weights)
