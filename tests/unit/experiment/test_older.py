"""What an earlier workbench recorded is understood, and said in today's words."""

import warnings
from pathlib import Path

import pytest

from workbench.recording.migrations import migrated
from workbench.utils.errors import InputError

PATH = Path("run.rrd")
VIDEO, MULTI = "workbench.datasets.video.Video", "workbench.datasets.multi_view.MultiView"
POINTS = "workbench.datasets.point_files.PointFiles"


@pytest.mark.parametrize("target", [VIDEO, MULTI])
@pytest.mark.parametrize(
    ("recorded", "today"),
    [
        ({"first_frame": 64, "last_frame": 160}, {"first_frame": 64, "n_frames": 97}),
        ({"first_frame": 64, "last_frame": 160, "n_frames": 10}, {"first_frame": 64, "n_frames": 10}),
        ({"first_frame": 64, "last_frame": 70, "n_frames": 10}, {"first_frame": 64, "n_frames": 7}),
    ],
)
def test_the_last_frame_is_a_number_of_frames(target, recorded, today):
    with pytest.warns(UserWarning, match=rf"dataset.last_frame=\d+ is dataset.n_frames={today['n_frames']} today"):
        found = migrated(PATH, {"seed": 1, "dataset": {"_target_": target, **recorded}})
    assert found == {"seed": 1, "dataset": {"_target_": target, **today}}


def test_the_first_frame_of_a_truth_is_where_it_begins():
    with pytest.warns(UserWarning, match="dataset.first_frame=2 is dataset.truth_first=-2 today"):
        found = migrated(PATH, {"dataset": {"_target_": POINTS, "source": "x", "first_frame": 2}})
    assert found["dataset"] == {"_target_": POINTS, "source": "x", "truth_first": -2}


@pytest.mark.parametrize(
    "settings",
    [
        {"dataset": None}, {}, {"dataset": {"_target_": VIDEO, "first_frame": 3, "n_frames": 2}},
        {"dataset": {"_target_": POINTS, "first_frame": 3, "n_frames": None, "truth_first": 1}},
        {"dataset": {"_target_": "workbench.datasets.synthetic.Synthetic", "first_frame": 3}},
    ],
)  # fmt: skip
def test_what_is_said_migrated_stays(settings):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert migrated(PATH, settings) == settings


PRODUCT = {"_target_": "workbench.likelihoods.product.Product", "weights": {"edges": 0.5}}
WRAPPED = {"likelihood": {"_target_": "my.Wrapped", "device": "tpu"}, "terms": [1, 2]}


@pytest.mark.parametrize("device", ["cpu", None])
def test_a_key_that_is_gone_is_removed_wherever_it_is(device):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recorded = {"likelihood": {**WRAPPED, "terms": {"both": {**PRODUCT, "device": device}}}}
        assert migrated(PATH, recorded) == {"likelihood": {**WRAPPED, "terms": {"both": PRODUCT}}}
        assert migrated(PATH, {"likelihood": {**PRODUCT, "device": device}}) == {"likelihood": PRODUCT}


@pytest.mark.parametrize("device", ["gpu", ["cpu"], {"cpu": 1}])
def test_another_value_of_a_key_that_is_gone_is_refused_with_its_place(device):
    with pytest.raises(InputError, match=r"run\.rrd: likelihood\.device: expected cpu, .* found "):
        migrated(PATH, {"likelihood": {**PRODUCT, "device": device}})


def test_a_component_that_is_none_any_more_is_refused_with_its_place():
    recorded = {"_target_": "my.Wrapper", "base": {"_target_": "workbench.priors.partwise.Partwise"}}
    with pytest.raises(InputError, match=r"run\.rrd: prior\.base\._target_: .*Partwise was removed"):
        migrated(PATH, {"prior": recorded})


@pytest.mark.parametrize("found", [3.0, 5.0])
def test_a_key_that_is_fixed_today_is_removed_or_refused(found):
    smooth = {"_target_": "workbench.priors.smooth.Smooth"}
    if found == 3.0:
        assert migrated(PATH, {"prior": {**smooth, "start_velocity": found}}) == {"prior": smooth}
    else:
        with pytest.raises(InputError, match=r"prior\.start_velocity: expected 3\.0, which is fixed today, found 5\.0"):
            migrated(PATH, {"prior": {**smooth, "start_velocity": found}})
