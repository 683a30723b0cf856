"""Rendered images kept in compressed files between runs; such a file may be deleted at any time."""

import hashlib
import json
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path

import numpy as np

from workbench.datasets.rendering.perturbations import SHOWN
from workbench.datasets.rendering.sequence import Scene
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import AnyArray, ByteArray
from workbench.utils.atomic_write import optional_cache, whole_file


def image_key(scene: Scene, unseen: Iterable[str], code: str, motion: Motion, *arrays: AnyArray) -> str:
    """Name a scene's images: a digest of the code, the motion, further arrays, and the parameters but those unseen."""
    apart = {*unseen, "exact", "departures"}
    parameters = {field.name: getattr(scene, field.name) for field in fields(scene) if field.name not in apart}
    drawn = {name: scene.departure[name] for name in SHOWN}
    shown = [code, parameters | drawn | {"motion": motion.name}, motion.shape.as_dict()]
    digest = hashlib.sha256(json.dumps(shown).encode())
    for array in (motion.poses, *arrays):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def cached_images(
    cache: str | None, key: Callable[[], str], shape: tuple[int, int, int], render: Callable[[], ByteArray]
) -> ByteArray:
    """Return the images (F, height, width) that the folder `cache` keeps under a key, or else render them and, where
    there is a folder, keep them there as far as it can be written to."""
    if cache is None:
        return render()
    file = Path(cache).expanduser() / "scenes" / f"{key()[:32]}.npz"
    images = _read(file, shape)
    if images is None:
        images = render()
        with optional_cache(), whole_file(file, parents=True) as part, part.open("wb") as out:
            np.savez_compressed(out, images=images)
    return images


def _read(file: Path, shape: tuple[int, int, int]) -> ByteArray | None:
    """Return the images in `file`, or None where there is no such file or, with a warning, no sound one."""
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
