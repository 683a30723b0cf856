"""The frames of a run: decoded once as long as they can be kept, and all of them in any case."""

from itertools import islice

import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.core import frame_cache as clip_module
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.utils.errors import InputError

CAMERA = plain_camera(4, 3, 5.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))
BYTES = 12
"""Of one image."""


class Film:
    """Frames with an image each, and a note of every one that is decoded; the frame `broken` cannot be."""

    def __init__(self, n_frames, broken=None):
        self.info, self.broken, self.decoded = SequenceInfo("film", n_frames), broken, []

    def frames(self):
        for index in range(self.info.n_frames):
            if index == self.broken:
                raise InputError(f"film: frame {index} cannot be decoded")
            self.decoded.append(index)
            yield Frame(index, index / 10.0, (View(CAMERA, np.full((3, 4), index, np.uint8)),))


def indices(frames):
    return [frame.index for frame in frames]


def test_every_frame_is_decoded_once_when_it_is_asked_for():
    film = Film(5)
    clip = FrameCache(film)
    assert (len(clip), clip.info, film.decoded) == (5, film.info, [])
    first = next(iter(clip))
    assert film.decoded == [0]
    assert indices(clip) == indices(clip) == list(range(5))
    assert next(iter(clip)) is first
    assert film.decoded == list(range(5))


def test_several_may_go_through_at_once():
    film = Film(6)
    slow, fast = iter(clip := FrameCache(film)), iter(clip)
    taken = [next(slow).index, next(fast).index, next(fast).index, next(slow).index, next(slow).index]
    assert taken == [0, 0, 1, 1, 2]
    assert (indices(slow), indices(fast)) == ([3, 4, 5], [2, 3, 4, 5])
    assert film.decoded == list(range(6))


def test_beyond_the_limit_frames_are_decoded_again_and_that_is_said_once(monkeypatch):
    said = []
    monkeypatch.setattr(clip_module.log, "info", lambda sentence, *given: said.append(sentence % given))
    film = Film(6)
    clip = FrameCache(film, max_bytes=2 * BYTES + 1)  # of three images the third is the one that goes over it
    assert indices(clip) == list(range(6))
    assert film.decoded == list(range(6))  # the first to go beyond opens nothing again
    assert not said
    assert indices(clip) == indices(clip) == list(range(6))
    assert film.decoded == list(range(6)) * 3
    assert said == ["film: frames after the first 3 are decoded again"]
    assert indices(islice(clip, 3)) == [0, 1, 2]
    assert film.decoded == list(range(6)) * 3  # what is kept is not


def test_beyond_the_limit_several_may_go_through_at_once():
    one, other = iter(clip := FrameCache(Film(6), max_bytes=1)), iter(clip)
    pairs = [(next(one).index, next(other).index) for _ in range(6)]
    assert pairs == [(k, k) for k in range(6)]
    assert next(one, None) is next(other, None) is None


@pytest.mark.parametrize("max_bytes", [0, 100])
def test_a_dataset_of_no_frames_has_none(max_bytes):
    film = Film(0)
    clip = FrameCache(film, max_bytes)
    assert (len(clip), list(clip), list(clip)) == (0, [], [])


@pytest.mark.parametrize("max_bytes", [1, BYTES + 1, 1000])
def test_everyone_meets_a_frame_that_cannot_be_decoded(max_bytes):
    clip = FrameCache(Film(6, broken=3), max_bytes)
    for _ in range(3):
        with pytest.raises(InputError, match="frame 3 cannot be decoded"):
            list(clip)
        frames = iter(clip)
        assert [next(frames).index for _ in range(3)] == [0, 1, 2]


def test_what_a_dataset_refuses_to_know_is_refused_at_once():
    class Unknown:
        @property
        def info(self):
            raise InputError("unknown: no such file")

    with pytest.raises(InputError, match="no such file"):
        FrameCache(Unknown())
