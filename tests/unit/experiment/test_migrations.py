"""Settings of earlier versions are migrated to the current keys and values."""

import warnings
from pathlib import Path

import pytest

from workbench.recording.migrations import migrated, renamed_properties
from workbench.utils.errors import InputError

PATH = Path("run.rrd")
VIDEO, MULTI = "workbench.datasets.video.Video", "workbench.datasets.multi_view.MultiView"
POINTS = "workbench.datasets.point_files.PointFiles"


@pytest.mark.parametrize("target", [VIDEO, MULTI])
@pytest.mark.parametrize(
    ("recorded", "current"),
    [
        ({"first_frame": 64, "last_frame": 160}, {"first_frame": 64, "n_frames": 97}),
        ({"first_frame": 64, "last_frame": 160, "n_frames": 10}, {"first_frame": 64, "n_frames": 10}),
        ({"first_frame": 64, "last_frame": 70, "n_frames": 10}, {"first_frame": 64, "n_frames": 7}),
    ],
)
def test_last_frame_becomes_n_frames(target, recorded, current):
    with pytest.warns(UserWarning, match=rf"dataset.last_frame=\d+ is dataset.n_frames={current['n_frames']} today"):
        migrated_settings = migrated(PATH, {"seed": 1, "dataset": {"_target_": target, **recorded}})
    assert migrated_settings == {"seed": 1, "dataset": {"_target_": target, **current}}


def test_first_frame_of_points_becomes_truth_first_frame():
    with pytest.warns(UserWarning, match="dataset.first_frame=2 is dataset.truth_first_frame=-2 today"):
        migrated_settings = migrated(PATH, {"dataset": {"_target_": POINTS, "source": "x", "first_frame": 2}})
    assert migrated_settings["dataset"] == {"_target_": POINTS, "source": "x", "truth_first_frame": -2}


@pytest.mark.parametrize(
    "settings",
    [
        {"dataset": None}, {}, {"dataset": {"_target_": VIDEO, "first_frame": 3, "n_frames": 2}},
        {"dataset": {"_target_": POINTS, "first_frame": 3, "n_frames": None, "truth_first_frame": 1}},
        {"dataset": {"_target_": "workbench.datasets.synthetic.Synthetic", "first_frame": 3}},
    ],
)  # fmt: skip
def test_current_settings_stay_unchanged(settings):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert migrated(PATH, settings) == settings


SCENE = "workbench.datasets.points.Points"


@pytest.mark.parametrize(
    ("target", "recorded", "current"),
    [
        (SCENE, {"exact": True, "departures": {"camera": 0.01}}, {"perturb": False, "perturbations": {"camera": 0.01}}),
        (SCENE, {"exact": False, "start": "given"}, {"perturb": True, "initialization": "perturbed_truth"}),
        (SCENE, {"perturb": False, "initialization": "auto"}, {"perturb": False, "initialization": "auto"}),
        (VIDEO, {"camera": "c.toml", "which": "left"}, {"calibration_file": "c.toml", "camera_name": "left"}),
        (MULTI, {"camera": "c.toml", "which": ["left"]}, {"calibration_file": "c.toml", "cameras": ["left"]}),
        ("workbench.datasets.person.of_height", {"feet": True}, {"neck_and_feet": True}),
    ],
)
def test_renamed_keys_of_datasets_get_the_current_names(target, recorded, current):
    dataset = migrated(PATH, {"dataset": {"_target_": target, **recorded}})["dataset"]
    assert dataset == {"_target_": target, **current}


PRODUCT = {"_target_": "workbench.likelihoods.product.Product", "weights": {"edges": 0.5}}
WRAPPED = {"likelihood": {"_target_": "my.Wrapped", "device": "tpu"}, "terms": [1, 2]}


@pytest.mark.parametrize("device", ["cpu", None])
def test_a_removed_key_is_dropped_at_any_depth(device):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recorded = {"likelihood": {**WRAPPED, "terms": {"both": {**PRODUCT, "device": device}}}}
        assert migrated(PATH, recorded) == {"likelihood": {**WRAPPED, "terms": {"both": PRODUCT}}}
        assert migrated(PATH, {"likelihood": {**PRODUCT, "device": device}}) == {"likelihood": PRODUCT}


@pytest.mark.parametrize("device", ["gpu", ["cpu"], {"cpu": 1}])
def test_an_unsupported_value_of_a_removed_key_is_rejected_with_its_place(device):
    with pytest.raises(InputError, match=r"run\.rrd: likelihood\.device: expected cpu, .* found "):
        migrated(PATH, {"likelihood": {**PRODUCT, "device": device}})


def test_a_removed_component_is_rejected_with_its_place():
    recorded = {"_target_": "my.Wrapper", "base": {"_target_": "workbench.priors.partwise.Partwise"}}
    with pytest.raises(InputError, match=r"run\.rrd: prior\.base\._target_: .*Partwise was removed"):
        migrated(PATH, {"prior": recorded})


@pytest.mark.parametrize("value", [3.0, 5.0])
def test_a_key_with_a_fixed_value_is_dropped_or_rejected(value):
    smooth = {"_target_": "workbench.priors.smooth.Smooth"}
    if value == 3.0:
        assert migrated(PATH, {"prior": {**smooth, "start_velocity": value}}) == {"prior": smooth}
    else:
        with pytest.raises(InputError, match=r"prior\.start_velocity: expected 3\.0, which is fixed today, found 5\.0"):
            migrated(PATH, {"prior": {**smooth, "start_velocity": value}})


def test_keys_outside_components_and_experiments_get_the_current_names():
    recorded = {
        "seed": 1, "threads": 2, "parts": [], "learn": {"motions": "cmu", "leave_out": ["35"]},
        "clips": {"half": "choose", "report": ["02_01"]}, "protocol": {"half": "report", "shown": "a board passing"},
    }  # fmt: skip
    current = {
        "seed": 1, "n_threads": 2, "component_packages": [], "training": {"motions": "cmu", "exclude": ["35"]},
        "clips": {"split": "validation", "test": ["02_01"]}, "protocol": {"split": "test", "occlusion": "moving board"},
    }  # fmt: skip
    assert migrated(PATH, recorded) == migrated(PATH, current) == current
    recorded_provenance = {"experiment": "walk_best", "choices": ["experiment=walk_best", "prior=track"], "seed": 3}
    renamed = {"experiment": "walk_multi_cue", "choices": ["experiment=walk_multi_cue", "prior=track"], "seed": 3}
    assert renamed_properties({"provenance": recorded_provenance})["provenance"] == renamed


def test_likelihoods_get_the_current_keys_and_values():
    motion = {"_target_": "workbench.likelihoods.image_motion.ImageMotion"}
    recorded = {"likelihood": {**motion, "k": 2.0, "exponent": "sum", "points": "drawn", "background": "still"}}
    current = {**motion, "effective_pixels": 2.0, "reduction": "sum", "sampling": "random", "background": "static"}
    assert migrated(PATH, recorded) == {"likelihood": current}
