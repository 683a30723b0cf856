"""Models of walking and running, learned from recordings of CMU and of both Bandai data sets."""

import numpy as np
import pytest

from workbench.motion.models.activities import held_out_accuracy, learn_activities, mean_rates_hz
from workbench.motion.models.activity_cycles import activity_cycles
from workbench.motion.sources import find_clip, load_motion

CLIPS = (
    "02_01", "02_03", "35_02", "08_01", "16_15",
    *(f"dataset-1_{activity}_{style}_001" for activity in ("walk", "run") for style in ("active", "feminine", "proud")),
    *(f"dataset-2_{activity}_{style}_00{take}" for activity in ("walk", "run")
      for style in ("active", "elderly", "normal", "youthful") for take in (1, 2, 3)),
)  # fmt: skip


@pytest.fixture(scope="module")
def cycles(data):
    return activity_cycles([load_motion(find_clip(data, clip)) for clip in CLIPS])


def test_every_clip_has_cycles_of_its_activity(cycles):
    assert set(cycles.sources) == set(CLIPS)
    runs = np.array(cycles.activities) == "run"
    assert {source for source, run in zip(cycles.sources, runs, strict=True) if run} == {
        clip for clip in CLIPS if "run" in clip or clip == "02_03"
    }
    # a running cycle takes 0.55 to 0.95 s in every style
    assert 0.55 < cycles.durations_s[runs].min() < cycles.durations_s[runs].max() < 0.95
    assert 0.9 < np.median(cycles.durations_s[~runs]) < 1.2
    rates = mean_rates_hz(learn_activities(cycles))
    assert rates["run"] > 1.2 * rates["walk"]


def test_no_cycle_is_half_a_turn_from_the_others(cycles):
    """No cycle is 180° from the others, as it would be with the other solution of a joint's three Euler angles."""
    deviation = np.abs(cycles.curves - np.median(cycles.curves, axis=0))
    assert np.degrees(deviation.max()) < 130.0  # the rotation of a straight arm about its axis


def test_legs_distinguish_running_from_walking_in_held_out_clips(cycles):
    legs = cycles.of_angles(["lower_body"])
    assert held_out_accuracy(legs, legs.sources, 5) > 0.95


def test_few_components_explain_the_variance_of_the_paper(cycles):
    assert len(learn_activities(cycles).scales) < 9  # the paper has 5
    mean_error = np.degrees(np.sqrt(np.mean((cycles.curves - cycles.curves.mean(axis=0)) ** 2)))
    model = learn_activities(cycles, n_components=5)
    fitted = model.angles_at(model.scores[:, None], np.arange(64) / 64)
    assert np.degrees(np.sqrt(np.mean((fitted - cycles.curves) ** 2))) < 0.5 * mean_error
