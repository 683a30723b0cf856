"""The list of mutations fits the code: what it changes is there, once, and so are the tests that should notice."""

from tests.mutations.run import ROOT, mutations


def test_every_mutation_can_be_made_and_is_named_once():
    every = mutations()
    assert {mutation.name: mutation.flaw(ROOT) for mutation in every} == dict.fromkeys([m.name for m in every], "")
    assert len({mutation.name for mutation in every}) == len(every)
