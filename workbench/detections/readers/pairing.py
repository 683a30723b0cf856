"""Pairing of detections with the images of a source by the numbers in their names."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from workbench.detections.readers.detected_points import numbers_in_names
from workbench.utils.arrays import IntArray
from workbench.utils.decode import image_files
from workbench.utils.errors import InputError


def image_numbers(folder: Path) -> IntArray:
    """Return the numbers in the names of a folder's images, in order; 0, 1, 2, … where they are not all different."""
    stems = [file.stem for file in image_files(folder)]
    numbers = numbers_in_names(stems)
    in_order = np.array([numbers.get(stem, -1) for stem in stems])
    return in_order if (np.diff(in_order) > 0).all() and in_order[0] >= 0 else np.arange(len(stems))


def paired_frames(
    numbers: Mapping[str, IntArray], images: Mapping[str, IntArray]
) -> tuple[dict[str, IntArray], dict[str, str]]:
    """Return the frames, from 0 on, of detections by camera, −1 for none, and how they are paired where it is assumed.

    Detections belong to the image with their number. Where some numbers have no image, they count from another start:
    from 1 where images count from 0, or from where the first image is. All cameras' detections count alike. Where most
    numbers have no image, as those of times, and there are as many images, they are paired in order.

    Parameters
    ----------
    numbers : of the detections, increasing, by camera.
    images : numbers of all images of the camera, increasing.

    Raises
    ------
    InputError : for detections of which none belongs to an image.
    """
    starts = {name: _start(each, images[name]) for name, each in numbers.items()}
    shifts = set(starts.values()) - {0}
    if len(shifts) == 1:
        (shift,) = shifts
        starts = {
            name: shift if numbers[name][0] - shift >= images[name][0] else start for name, start in starts.items()
        }
    frames, assumptions = {}, {}
    for name, each in numbers.items():
        at = np.searchsorted(images[name], each - starts[name])
        inside = at < len(images[name])
        inside[inside] = images[name][at[inside]] == each[inside] - starts[name]
        if 2 * inside.sum() < len(each) == len(images[name]):
            frames[name] = np.arange(len(each))
            assumptions[name] = f"the detections numbered {each[0]} to {each[-1]} are taken for the images in order"
            continue
        frames[name] = np.where(inside, at, -1)
        if not inside.any():
            raise InputError(
                f"{name}: detections of frames {each[0]} to {each[-1]} belong to none of the images {images[name][0]} "
                f"to {images[name][-1]}"
            )
        if 2 * inside.sum() < len(each):
            assumptions[name] = f"{len(each) - inside.sum()} of {len(each)} frames with detections have no image"
        elif starts[name]:
            first = int(np.argmax(inside))
            image = images[name][frames[name][first]]
            assumptions[name] = f"the detections numbered {each[first]} are taken for the image numbered {image}"
    return frames, assumptions


def _start(numbers: IntArray, images: IntArray) -> int:
    """Return the excess of the detections' numbers over those of their images."""
    if np.isin(numbers, images).all():
        return 0
    first, span = int(numbers[0] - images[0]), int(images[-1] - images[0])
    if int(numbers[-1] - numbers[0]) == span or not np.isin(numbers, images).any():
        return first if int(numbers[-1] - numbers[0]) <= span else 0
    return 1 if numbers[0] > images[0] and numbers[-1] == images[-1] + 1 else 0
