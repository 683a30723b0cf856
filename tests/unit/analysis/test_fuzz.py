"""The mutations of `analysis.fuzz`."""

import random

from analysis.fuzz import changed_arguments, changed_text


def test_mutations_are_repeatable_and_of_several_kinds():
    content = b"rate: 30.0\nname: walk\n" * 20
    drawn = [changed_text(content, random.Random(seed)) for seed in range(200)]
    assert drawn == [changed_text(content, random.Random(seed)) for seed in range(200)]
    assert sum(changed != content for changed, _ in drawn) > 180
    assert len({what.split()[0] for _, what in drawn}) >= 10


def test_a_changed_argument_leaves_the_command():
    arguments = ["export", "run.rrd", "-o", "walk.trc"]
    drawn = [changed_arguments(list(arguments), random.Random(seed))[0] for seed in range(100)]
    assert {each[0] for each in drawn} == {"export"}
    assert sum(each != arguments for each in drawn) > 80
    assert not any("\0" in word for each in drawn for word in each)
