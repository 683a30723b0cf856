"""Detection of every person in every frame of a video by a landmark network.

A grid of square regions is searched in the first frame and at the end of every chunk of frames. In between, each person
is detected in the region that follows from the frame before. People first found at the end of a chunk are followed
backwards to its start, so that no person appears late. Threads share the regions of a grid, and those of the people in
one frame; the result does not depend on them.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from workbench.detections.detector.landmark_network import PersonLandmarks, Region
from workbench.utils.arrays import ByteArray
from workbench.utils.parallel import Helpers

Network = Callable[[ByteArray, Region], PersonLandmarks]

MIN_PRESENCE = 0.5
"""Smallest probability that a region shows a person."""
_SIDES = (1.0, 0.7, 0.5, 0.35)
"""Sides of the regions of the grid over the longer side of the image."""
_PROMISING = 0.1
"""Smallest presence in a region of the grid for which it is refined."""
_N_REFINEMENTS = 4
_SAME_PERSON = 0.15
"""Largest mean distance of two detections' landmarks, over their region's side, for which they show one person."""
_MAX_HELPERS = 3
"""Threads, each of which holds a network of 45 MB."""
_Landmarks = Callable[[], PersonLandmarks]


@dataclass(frozen=True, eq=False)
class Person:
    """A detected person. number: the same in all frames in which the person is followed without a gap."""

    number: int
    landmarks: PersonLandmarks


class PeopleDetector:
    """Detects people in the frames of a video, in order.

    Parameters
    ----------
    network : returns the landmarks of the person in a region of an image; called by several threads.
    chunk_frames : frames between two searches of the whole image, at least 1; they are in memory at once.
    on_search : called with the people found by every search of a whole image.
    """

    def __init__(
        self, network: Network, chunk_frames: int, on_search: Callable[[Sequence[Person]], None] = lambda _: None
    ) -> None:
        self.network, self.chunk_frames, self.on_search = network, chunk_frames, on_search
        self._n_people = 0

    def detect(
        self, images: Iterable[ByteArray], previous: Sequence[Person] | None = None, n_people: int = 0
    ) -> Iterator[list[Person]]:
        """Yield the people in each image (height, width, 3), RGB.

        previous: those in the frame before the first, from whom the detection is resumed; None for a new one.
        n_people: number of people in all frames before.
        """
        self._n_people, people, source = n_people, list(previous or ()), iter(images)
        with Helpers(_MAX_HELPERS) as helpers:
            if previous is None:
                start = list(islice(source, 1))  # searched before further images are decoded, as a user waits for it
                people = [each for image in start for each in self._search(image, self._begin_grid(helpers, image), [])]
                self.on_search(people)
                source = chain(start, source)
            while chunk := list(islice(source, self.chunk_frames)):
                searched, frames = self._begin_grid(helpers, chunk[-1]), []
                for image in chunk:
                    people = self._follow(helpers, image, people)
                    frames.append(people)
                new = self._search(chunk[-1], searched, people)
                self.on_search(new)
                for t in range(len(chunk) - 1, -1, -1):
                    new = self._follow(helpers, chunk[t], new, frames[t]) if new else []
                    frames[t] = [*frames[t], *new]
                people = frames[-1]
                yield from frames

    def _begin_grid(self, helpers: Helpers, image: ByteArray) -> list[_Landmarks]:
        """Return functions that return the landmarks in the regions of the grid."""
        return [helpers.begin(self.network, image, region) for region in grid(image.shape[1], image.shape[0])]

    def _follow(
        self, helpers: Helpers, image: ByteArray, people: Sequence[Person], others: Sequence[Person] = ()
    ) -> list[Person]:
        """Return those of the people of a neighbouring frame who are in the image and are none of the others."""
        present: list[Person] = []
        begun = [helpers.begin(self.network, image, person.landmarks.next_region) for person in people]
        for person, landmarks_of in zip(people, begun, strict=True):
            landmarks = landmarks_of()
            if landmarks.presence >= MIN_PRESENCE and not _known(landmarks, [*others, *present]):
                present.append(Person(person.number, landmarks))
        return present

    def _search(self, image: ByteArray, searched: Sequence[_Landmarks], people: Sequence[Person]) -> list[Person]:
        """Return the people in the image who are none of those already detected.

        searched : functions that return the landmarks in the regions of the grid.
        """
        new: list[Person] = []
        for landmarks_of in searched:
            landmarks = landmarks_of()
            for _ in range(_N_REFINEMENTS):
                if landmarks.presence < _PROMISING or _known(landmarks, [*people, *new]):
                    break
                landmarks = self.network(image, landmarks.next_region)
            if landmarks.presence >= MIN_PRESENCE and not _known(landmarks, [*people, *new]):
                new.append(Person(self._n_people, landmarks))
                self._n_people += 1
        return new


def grid(width: int, height: int) -> Iterator[Region]:
    """Yield overlapping square regions that cover an image, large ones first."""
    for side in (share * max(width, height) for share in _SIDES):
        for u in _centres(side, width):
            for v in _centres(side, height):
                yield Region(float(u), float(v), side)


def _centres(side: float, size: int) -> Sequence[float]:
    """Return centres along one axis, at most half a side apart, whose squares lie in the image where they fit."""
    if side >= size:
        return [0.5 * size]
    n = int(np.ceil((size - side) / (0.5 * side))) + 1
    return [float(x) for x in np.linspace(0.5 * side, size - 0.5 * side, n)]


def _known(landmarks: PersonLandmarks, people: Iterable[Person]) -> bool:
    """Return whether the landmarks are those of one of the people."""
    for person in people:
        distances = np.linalg.norm(landmarks.pixels - person.landmarks.pixels, axis=1)
        if distances.mean() < _SAME_PERSON * max(landmarks.next_region.side, person.landmarks.next_region.side):
            return True
    return False
