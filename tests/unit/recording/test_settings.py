"""A configuration key by key: each key of one type in whatever recording."""

from hypothesis import given
from hypothesis import settings as trials
from hypothesis import strategies as st

from workbench.recording.settings import NO_EFFECT, choices_of, leaves, numbers_and_texts

SETTINGS = {
    "seed": 3, "threads": None, "prior": {"_target_": "workbench.priors.smooth.Smooth", "sigma": 1.0e-3, "held": True},
    "dataset": {"motion": "35_02", "view": [1, 2.5]}, "clips": {"choose": ["35_02"]}, "paths": {"data": "/my/own"},
}  # fmt: skip


def test_numbers_are_told_from_texts():
    numbers, texts = numbers_and_texts(SETTINGS, {"prior": "smooth"})
    assert numbers == {"seed": 3.0, "prior.sigma": 1.0e-3}
    assert texts == {"prior.held": "true", "dataset.motion": "35_02", "dataset.view": "[1, 2.5]", "prior": "smooth"}


def test_leaves_go_into_lists_where_that_is_asked_for():
    nested = {"a": {"b": [1, {"c": 2}]}, "d": {}, "e": []}
    assert dict(leaves(nested)) == {"a.b": [1, {"c": 2}], "e": []}
    assert dict(leaves(nested, lists=True)) == {"a.b[0]": 1, "a.b[1].c": 2, "d": {}, "e": []}


def test_what_has_no_effect_is_no_column():
    assert numbers_and_texts({key: {"n": 1, "word": "w"} for key in NO_EFFECT}, {"recorder": "rerun"}) == ({}, {})


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats() | st.text(max_size=5),
    lambda of: st.lists(of, max_size=3) | st.dictionaries(st.text(max_size=5), of, max_size=4),
)


@trials(max_examples=40)
@given(settings=st.dictionaries(st.text(max_size=5), VALUES), words=st.lists(st.text(max_size=8)) | st.text(max_size=8))
def test_whatever_a_configuration_holds_its_keys_are_numbers_or_texts(settings, words):
    numbers, texts = numbers_and_texts(settings, choices_of(words))
    assert all(type(value) is float for value in numbers.values())
    assert all(type(value) is str for value in texts.values())
    assert "" not in {*numbers, *texts}
