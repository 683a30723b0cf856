"""Invalid options of datasets are errors that name the option, before any frame is made."""

import numpy as np
import pytest

from workbench.datasets.blank import Blank
from workbench.datasets.point_files import PointFiles
from workbench.datasets.points import Points
from workbench.datasets.stereo import Stereo
from workbench.datasets.synthetic import Synthetic
from workbench.utils.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # the camera's distance is increased
NAN, INF = float("nan"), float("inf")
KEYS = [
    *[(Points, key, value) for key, value in (
        ("n_frames", 1), ("first_frame", -1), ("n_points", 0), ("sigma_m", -0.1), ("sigma_m", NAN),
        ("outlier_fraction", 1.0), ("outlier_fraction", -0.1), ("n_clutter_points", -1), ("occluder_width_m", -1.0),
        ("distance_m", 0.5), ("rate_hz", 0.0), ("view_azimuth_deg", INF),
        ("focal_px", 0.0), ("seed", -1), ("initialization", "soon"), ("motion", "unknown"), ("motion", 3502),
    )],
    *[(Stereo, key, value) for key, value in (
        ("baseline_m", 0.0), ("baseline_m", 3.0), ("rate_hz", -1.0), ("n_points", 0), ("noise_std", NAN),
        ("view_azimuth_deg", NAN), ("initialization", "soon"),
    )],
    *[(Synthetic, key, value) for key, value in (
        ("n_frames", 1), ("first_frame", -1), ("person_px", 0.0), ("seed", -1), ("path", "zigzag"),
        ("keypoint_sigma_px", -1.0), ("perturbations", {"height": 0.1}),
        ("perturbations", {"radii": -0.1}), ("perturbations", {"camera": 2.0}),
        ("perturbations", {"clothes_m": np.nan}),
    )],
    *[(Blank, key, value) for key, value in (("n_frames", 0), ("first_frame", -1), ("rate_hz", 0.0))],
    *[(PointFiles, key, value) for key, value in (
        ("unit", "yard"), ("rate_hz", 0.0), ("max_points", 0), ("first_frame", -1), ("n_frames", 0), ("seed", -1),
        ("initialization", "soon"),
    )],
]  # fmt: skip
COMBINATIONS = [
    (Points, {"n_frames": 5000}, "lasts 60.0"),
    (Points, {"motion": "builtin_arm", "initialization": "perturbed_truth"}, "no gait cycle"),
    (Points, {"motion": []}, "at least one motion"),
    (Points, {"motion": ["builtin", "35_02"]}, "35_02"),
    (Stereo, {"n_frames": 5000}, "lasts"),
    (Synthetic, {"first_frame": 1800}, "1801 frames at 30 Hz"),
    (Synthetic, {"calibration_file": "none.toml"}, "none.toml: no such"),
    (Synthetic, {"motion": "none.bvh"}, "none.bvh: no such file"),
    (Synthetic, {"motion": "35_02"}, "paths.data"),
    (Synthetic, {"motion": "35_02", "data": "nowhere"}, "35_02.amc"),
    (Blank, {"first_frame": 10**6}, "1000000"),
    (PointFiles, {"n_frames": 2}, "no frame 1, expected"),
    (PointFiles, {"truth": "none", "truth_first_frame": 1}, "truth_first_frame"),
]


def error_message(dataset, keys, folder):
    if dataset is PointFiles:
        np.savez(folder / "frame_0.npz", points=np.ones((2, 3)))
        keys = {"source": str(folder), **keys}
    with pytest.raises(InputError) as error:
        _ = dataset(**keys).info
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(("dataset", "key", "value"), KEYS)
def test_the_error_of_an_option_out_of_range_names_it(dataset, key, value, tmp_path):
    message = error_message(dataset, {key: value}, tmp_path)
    assert key in message


@pytest.mark.parametrize(("dataset", "keys", "words"), COMBINATIONS)
def test_the_error_of_inconsistent_options_describes_them(dataset, keys, words, tmp_path):
    assert words in error_message(dataset, keys, tmp_path)
