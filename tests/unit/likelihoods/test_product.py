"""The product of likelihoods: powers, variance fractions, updates and invalid weights."""

from types import SimpleNamespace

import likelihood_scenes as scenes
import numpy as np
import pytest

from workbench.core.likelihood import Evaluation
from workbench.likelihoods.product import Product, variance_fractions
from workbench.likelihoods.uniform import Uniform
from workbench.utils.errors import InputError

FRAME = scenes.frame(0, (scenes.FRONT, scenes.flat(0)))
POSES = np.zeros((4, 25))


class Fixed:
    """A likelihood with the same values for any poses, which counts its updates."""

    def __init__(self, *log_prob, notes=(), updated=0):
        self.values, self.notes, self.updated = np.array(log_prob, dtype=float), notes, updated

    def prepare(self, previous, frame):
        return SimpleNamespace(
            notes=tuple(f"{note} of the frame" for note in self.notes),
            diagnostics={"constant": 0.0},
            evaluate=lambda previous_pose, pose: Evaluation(self.values, self.notes, {"constant": 3.0}),
            update=lambda pose: Fixed(*self.values, notes=self.notes, updated=self.updated + 1),
        )


def evaluate(product):
    return product.prepare(FRAME, FRAME).evaluate(POSES, POSES)


def test_weights_are_exponents_of_the_likelihoods():
    product = Product({"a": Fixed(0, 1, 2, 3), "b": Fixed(4, 0, 0, 4)}, {"a": 0.5, "b": 2.0})
    np.testing.assert_array_equal(evaluate(product).log_prob, [8.0, 0.5, 1.0, 9.5])


def test_a_term_with_zero_weight_is_not_evaluated():
    product = Product({"off": Fixed(np.nan, np.nan, np.nan, np.nan), "a": Fixed(0, 1, 2, 3)}, {"a": 1.0, "off": 0.0})
    np.testing.assert_array_equal(evaluate(product).log_prob, [0.0, 1.0, 2.0, 3.0])
    assert set(evaluate(product).diagnostics) == {"constant", "variance_fraction_a"}
    updated = scenes.after_first_frame(product, FRAME, POSES[0])
    assert {name: term.updated for name, term in updated.terms.items()} == {"off": 0, "a": 1}
    assert list(updated.terms) == ["off", "a"]


def test_a_product_of_zero_weights_is_uniform():
    evaluation = evaluate(Product({"a": Fixed(0, 1, 2, 3)}, {"a": 0.0}))
    np.testing.assert_array_equal(evaluation.log_prob, np.zeros(4))
    assert evaluation.diagnostics == {}


def test_variance_fractions_sum_to_one_and_may_be_negative():
    a, b = np.array([0.0, 3.0, 6.0, 9.0]), np.array([3.0, 2.0, 1.0, 0.0])
    fractions = variance_fractions({"a": a, "b": b}, a + b)
    assert fractions == pytest.approx({"a": 1.5, "b": -0.5})  # b is −a/3 and a constant
    impossible = np.array([-np.inf, 0.0, 0.0, 0.0])
    fractions = variance_fractions({"a": a, "b": b + impossible}, a + b + impossible)
    assert fractions == pytest.approx({"a": 1.5, "b": -0.5})
    assert variance_fractions({"a": np.ones(4)}, np.ones(4)) == {"a": 0.0}


def test_terms_are_updated_and_their_notes_and_diagnostics_are_passed_on():
    terms = {"a": Fixed(0, 1, 0, 0, notes=("careful",)), "b": Uniform()}
    product = Product(terms, {"a": 1.0, "b": 1.0})
    first = product.prepare(None, FRAME)
    assert first.diagnostics == {"constant": 0.0, "variance_fraction_a": 0.0, "variance_fraction_b": 0.0}
    assert first.notes == ("careful of the frame",)
    assert evaluate(product).notes == ("careful",)
    assert evaluate(product).diagnostics == {"constant": 3.0, "variance_fraction_a": 1.0, "variance_fraction_b": 0.0}
    updated = scenes.after_first_frame(first.update(POSES[0]), FRAME, POSES[0])
    assert updated.terms["a"].updated == 2
    assert terms["a"].updated == 0


@pytest.mark.parametrize(
    ("terms", "weights", "message"),
    [
        ({}, {}, "needs at least one term"),
        ({"a": Uniform()}, {"b": 1.0}, "weights: expected a, found b"),
        ({"a": Uniform()}, {}, "weights: expected a, found none"),
        ({"a": Uniform()}, {"a": -1.0}, "the weight of a must be at least 0, found -1.0"),
        ({"a": Uniform()}, {"a": float("nan")}, "the weight of a must be at least 0, found nan"),
    ],
)
def test_invalid_terms_and_weights_are_an_error(terms, weights, message):
    with pytest.raises(InputError, match=message):
        Product(terms, weights)
