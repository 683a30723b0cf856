"""The list of mutations fits the code: what it changes is there, once, and so are the tests that should notice."""

import pytest

from tests.mutations.run import ROOT, mutations

MUTATIONS = mutations()


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_every_mutation_can_be_made(mutation):
    assert mutation.flaw(ROOT) == ""


def test_mutations_have_different_names_and_each_says_what_is_wrong():
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS)
    assert all(mutation.wrong.endswith(".") for mutation in MUTATIONS)
