"""On-disk cache of rendered images, in files that may be deleted at any time."""

import hashlib
import json
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path

import numpy as np

from workbench.datasets.rendering.perturbations import VISIBLE
from workbench.datasets.rendering.sequence import Scene
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import AnyArray, ByteArray
from workbench.utils.atomic_write import optional_cache, whole_file
from workbench.utils.input_path import expanded


def image_key(scene: Scene, unseen: Iterable[str], code: str, motion: Motion, *arrays: AnyArray) -> str:
    """Return the cache key of a scene's images. unseen: parameters of the scene that do not change its images. code:
    digest of the rendering code. motion, arrays: further inputs."""
    excluded = {*unseen, "perturb", "perturbations"}
    parameters = {field.name: getattr(scene, field.name) for field in fields(scene) if field.name not in excluded}
    sizes = {name: scene.perturbation_sizes[name] for name in VISIBLE}
    inputs = [code, parameters | sizes | {"motion": motion.name}, motion.shape.as_dict()]
    digest = hashlib.sha256(json.dumps(inputs).encode())
    for array in (motion.poses, *arrays):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def cached_images(
    cache: str | None, key: Callable[[], str], shape: tuple[int, int, int], render: Callable[[], ByteArray]
) -> ByteArray:
    """Return the images (F, height, width) of a key from the folder `cache`, or else render and, where possible, store
    them; None: no cache."""
    if cache is None:
        return render()
    file = expanded(cache) / "scenes" / f"{key()[:32]}.npz"
    images = _read(file, shape)
    if images is None:
        images = render()
        with optional_cache(), whole_file(file, parents=True) as part, part.open("wb") as out:
            np.savez(out, images=images)  # uncompressed: noise compresses by a tenth only, and slowly
    return images


def _read(file: Path, shape: tuple[int, int, int]) -> ByteArray | None:
    """Return the images in `file`; None without a file and, with a warning, for a damaged one."""
    if not file.exists():
        return None
    try:
        with np.load(file, allow_pickle=False) as stored:
            images: ByteArray = stored["images"]
        if images.dtype == np.uint8 and images.shape == shape:
            return images
        defect = f"expected {shape} uint8, found {images.shape} {images.dtype}"
    except (OSError, ValueError, LookupError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        defect = f"{type(error).__name__}: {error}"
    warnings.warn(f"{file}: damaged ({defect}); its images are rendered again", stacklevel=2)
    return None
