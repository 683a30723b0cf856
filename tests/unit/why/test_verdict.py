"""What futures come to: counted, ranked, said."""

import numpy as np
import pytest

from workbench.results.why.changes import SAME, SAME_WHOLE, Change
from workbench.results.why.futures import Future
from workbench.results.why.verdict import ranked, sentence, table, verdict

CAMERA = Change("the camera as it is", whole=True)
CUE = Change("without edges")


def futures(change, held, error, n=5):
    frames = np.arange(3)
    parts = frames, np.full(3, error), frames / 30.0, np.zeros((3, 15, 3)), ()
    return [Future(change, seed, *parts, seed < held) for seed in range(n)]


def test_what_holds_more_often_comes_first_and_then_what_errs_less():
    found = ranked([verdict(futures(*each)) for each in [(SAME, 1, 2.0), (CUE, 3, 0.9), (CAMERA, 3, 0.4)]])
    assert [each.change for each in found] == [CAMERA, CUE, SAME]
    assert (found[0].held, found[0].n, found[0].error) == (3, 5, pytest.approx(0.4))
    assert 0.0 < found[0].low < 0.6 < found[0].high < 1.0


def test_a_change_is_measured_by_another_seed_of_the_same_stretch():
    told = [(CAMERA, 5, 0.3), (SAME_WHOLE, 0, 2.0), (SAME, 4, 1.0)]
    words = sentence(ranked([verdict(futures(*each)) for each in told]))
    assert "the camera as it is, which holds in 5 of 5 where another seed alone holds in 0 of 5 (p = 0.004" in words


@pytest.mark.parametrize("held", [3, 5])
def test_where_another_seed_does_as_well_it_was_chance(held):
    words = sentence(ranked([verdict(futures(CUE, held, 0.3)), verdict(futures(SAME, held, 0.5))]))
    assert words.startswith("chance, as far as can be told")


def test_the_table_marks_whole_runs():
    lines = table([verdict(futures(CAMERA, 5, 0.3)), verdict(futures(CUE, 0, 1.5))]).splitlines()
    assert "*the camera as it is" in lines[1]
    assert " without edges" in lines[2]
    assert lines[2].split()[:3] == ["0", "of", "5"]
