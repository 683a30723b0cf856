"""The grey or colour levels of a view, as likelihoods look at them: as float32, smoothed."""

import cv2
import numpy as np

from workbench.arrays import AnyArray, Float32Array
from workbench.core.frame import View
from workbench.errors import InputError


def grey_levels(view: View, blur_px: float) -> Float32Array:
    """The view's grey levels (height, width), 0..255, smoothed by a Gaussian (A, section 5).

    Raises InputError when the image has not the size that its camera states.
    """
    levels = _float_levels(view)
    return _smoothed(cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY) if levels.ndim == 3 else levels, blur_px)


def colour_levels(view: View, blur_px: float) -> Float32Array:
    """The view's one or three levels (height, width, C), 0..255, smoothed by a Gaussian; raises as `grey_levels`."""
    smooth = _smoothed(_float_levels(view), blur_px)
    return smooth.reshape(*smooth.shape[:2], -1)


def _smoothed(image: AnyArray, blur_px: float) -> Float32Array:
    smooth = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px > 0.0 else image
    return np.ascontiguousarray(smooth, dtype=np.float32)


def _float_levels(view: View) -> Float32Array:
    camera, image = view.camera, view.image
    if image.shape[:2] != (camera.height, camera.width) or image.shape[2:] not in ((), (3,)):
        raise InputError(
            f"likelihood: camera {camera.name}: expected a grey or RGB image of {camera.width}×{camera.height} px, "
            f"found an array of shape {image.shape}"
        )
    return image.astype(np.float32)
