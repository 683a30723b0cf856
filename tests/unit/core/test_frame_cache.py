"""The cache of decoded frames: one decoding up to the memory limit, and every frame in every iteration."""

from itertools import islice

import numpy as np
import pytest

from workbench.cameras.camera import plain_camera
from workbench.core import frame_cache
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache, without_images
from workbench.utils.errors import InputError

CAMERA = plain_camera(4, 3, 5.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))
IMAGE_BYTES = 12


class CountingDataset:
    """Frames with one image; `decoded` lists the decoded frames, and the frame `broken` raises an error."""

    def __init__(self, n_frames, broken=None):
        self.info, self.broken, self.decoded = SequenceInfo("clip", n_frames), broken, []

    def frames(self):
        for index in range(self.info.n_frames):
            if index == self.broken:
                raise InputError(f"clip: frame {index} cannot be decoded")
            self.decoded.append(index)
            yield Frame(index, index / 10.0, (View(CAMERA, np.full((3, 4), index, np.uint8)),))


def indices(frames):
    return [frame.index for frame in frames]


def test_every_frame_is_decoded_once_on_demand():
    dataset = CountingDataset(5)
    cache = FrameCache(dataset)
    assert (len(cache), cache.info, dataset.decoded) == (5, dataset.info, [])
    first = next(iter(cache))
    assert dataset.decoded == [0]
    assert indices(cache) == indices(cache) == list(range(5))
    assert next(iter(cache)) is first
    assert dataset.decoded == list(range(5))


def test_iterations_may_alternate():
    dataset = CountingDataset(6)
    slow, fast = iter(cache := FrameCache(dataset)), iter(cache)
    order = [next(slow).index, next(fast).index, next(fast).index, next(slow).index, next(slow).index]
    assert order == [0, 0, 1, 1, 2]
    assert (indices(slow), indices(fast)) == ([3, 4, 5], [2, 3, 4, 5])
    assert dataset.decoded == list(range(6))


def test_frames_beyond_the_memory_are_decoded_again_with_one_message(monkeypatch):
    messages = []
    monkeypatch.setattr(frame_cache.log, "info", lambda message, *args: messages.append(message % args))
    dataset = CountingDataset(6)
    cache = FrameCache(dataset, max_bytes=2 * IMAGE_BYTES + 1)  # the third image exceeds it
    assert indices(cache) == list(range(6))
    assert dataset.decoded == list(range(6))  # the first iteration continues the decoding
    assert not messages
    assert indices(cache) == indices(cache) == list(range(6))
    assert dataset.decoded == list(range(6)) * 3
    assert messages == ["clip: frames after the first 3 are decoded again"]
    assert indices(islice(cache, 3)) == [0, 1, 2]
    assert dataset.decoded == list(range(6)) * 3  # cached frames are not decoded again


def test_iterations_may_alternate_beyond_the_memory():
    first, second = iter(cache := FrameCache(CountingDataset(6), max_bytes=1)), iter(cache)
    pairs = [(next(first).index, next(second).index) for _ in range(6)]
    assert pairs == [(k, k) for k in range(6)]
    assert next(first, None) is next(second, None) is None


@pytest.mark.parametrize("max_bytes", [0, 100])
def test_a_dataset_without_frames_gives_none(max_bytes):
    dataset = CountingDataset(0)
    cache = FrameCache(dataset, max_bytes)
    assert (len(cache), list(cache), list(cache)) == (0, [], [])


@pytest.mark.parametrize("max_bytes", [1, IMAGE_BYTES + 1, 1000])
def test_every_iteration_raises_the_error_of_a_frame(max_bytes):
    cache = FrameCache(CountingDataset(6, broken=3), max_bytes)
    for _ in range(3):
        with pytest.raises(InputError, match="frame 3 cannot be decoded"):
            list(cache)
        frames = iter(cache)
        assert [next(frames).index for _ in range(3)] == [0, 1, 2]


def test_an_error_of_the_metadata_is_raised_at_once():
    class Missing:
        @property
        def info(self):
            raise InputError("clip: no such file")

    with pytest.raises(InputError, match="no such file"):
        FrameCache(Missing())


def test_frames_without_images_are_those_of_a_dataset_that_has_them_or_decoded_ones():
    dataset = CountingDataset(3)
    for frames in (FrameCache(dataset), dataset.frames()):
        assert [(frame.index, frame.views[0].image.size) for frame in without_images(frames)] == [
            (0, 0),
            (1, 0),
            (2, 0),
        ]
    dataset.decoded.clear()
    dataset.frames_without_images = lambda: (frame.without_images for frame in CountingDataset(3).frames())
    assert indices(without_images(FrameCache(dataset))) == [0, 1, 2]
    assert not dataset.decoded
