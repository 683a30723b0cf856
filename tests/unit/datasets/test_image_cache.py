"""The cache of rendered images returns what would be rendered, for another value of any parameter."""

from dataclasses import fields

import numpy as np
import pytest

from workbench.datasets.stereo import Stereo
from workbench.datasets.synthetic import Synthetic

SCENE = {
    "motion": "builtin_run", "data": "elsewhere", "path": "circle", "n_frames": 3, "first_frame": 1, "rate_hz": 20.0,
    "width": 144, "height": 104, "focal_px": 150.0, "view_azimuth_deg": 60.0, "seed": 1, "perturb": True,
    "perturbations": {"lengths": 0.1}, "noise_std": 2.0, "contrast": 2.0, "clutter": 0.5,
}  # fmt: skip
CAMERA = """
[wide]
size = [128, 96]
matrix = [[80.0, 0.0, 63.5], [0.0, 80.0, 47.5], [0.0, 0.0, 1.0]]
distortions = [-0.1, 0.0, 0.0, 0.0]
rotation = [1.5707963267948966, 0.0, 0.0]
translation = [0.0, 1.0, 4.0]
"""
VALUES = {
    Synthetic: SCENE | {"moving": ("root_x",), "calibration_file": CAMERA, "person_px": 60.0, "occluder": True,
                        "neck_and_feet": True, "keypoint_sigma_px": 2.0},
    Stereo: SCENE | {"n_points": 50, "baseline_m": 0.3, "distance_m": 3.0, "initialization": "perturbed_truth"},
}  # fmt: skip
UNSEEN = {Synthetic: {"data", "keypoint_sigma_px"}, Stereo: {"data", "initialization", "n_points"}}
BASE = {"n_frames": 2, "width": 128, "height": 96, "focal_px": 140.0, "perturb": False}


@pytest.mark.parametrize("dataset", VALUES)
def test_the_key_of_cached_images_has_every_parameter_that_changes_them(tmp_path, dataset):
    """Parameters that are not in the key change no pixel."""
    assert VALUES[dataset].keys() | {"cache"} == {field.name for field in fields(dataset)}
    base, without = dataset(**BASE), set()
    for name, value in VALUES[dataset].items():
        if name == "calibration_file":
            (tmp_path / "camera.toml").write_text(value)
            value = str(tmp_path / "camera.toml")
        changed = dataset(**BASE | {name: value})
        if changed._key() == base._key():
            without.add(name)
            np.testing.assert_array_equal(changed._images, base._images)
    assert without == UNSEEN[dataset]
