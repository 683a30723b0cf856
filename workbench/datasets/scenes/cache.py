"""Rendered images kept in compressed files between runs; such a file may be deleted at any time."""

import warnings
import zipfile
import zlib
from pathlib import Path

import numpy as np

from workbench.arrays import ByteArray
from workbench.files import whole_file


def read_images(file: Path, shape: tuple[int, int, int]) -> ByteArray | None:
    """The images (F, height, width) in `file`, or None where there is no such file or, with a warning, no sound one."""
    if not file.exists():
        return None
    try:
        with np.load(file, allow_pickle=False) as stored:
            images: ByteArray = stored["images"]
        if images.dtype == np.uint8 and images.shape == shape:
            return images
        found = f"{images.dtype} {images.shape}"
    except (OSError, ValueError, LookupError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        found = f"{type(error).__name__}: {error}"
    warnings.warn(f"{file}: damaged ({found}), so its images are rendered again", stacklevel=2)
    return None


def write_images(file: Path, images: ByteArray) -> None:
    """Write images (F, height, width) to `file` in one step: a reader sees the whole file or none.

    Raises InputError when the folder cannot be written to.
    """
    with whole_file(file, parents=True) as part, part.open("wb") as out:
        np.savez_compressed(out, images=images)
