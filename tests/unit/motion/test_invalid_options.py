"""Invalid options of motion generators and learners."""

import numpy as np
import pytest

from workbench.motion.models.activities import learn_activities
from workbench.motion.models.activity_cycles import activity_cycles
from workbench.motion.models.cycle_alignment import align
from workbench.motion.models.training import activity_model, database_motions, training_motions
from workbench.motion.models.walking import learn_walking
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import average_subject, builtin_motions, walker
from workbench.motion.synthetic.run_gait import average_runner, runner
from workbench.utils.errors import InputError

NAN = float("nan")
NOISE = np.random.default_rng(0).normal(size=(100, 2))
PAPER = {"variance": 0.95, "n_components": None, "scaling": "none"}
OPTIONS = [
    (walker, {"path": "zigzag"}, "zigzag"),
    *[(make, wrong, "two frames") for make in (walker, runner)
      for wrong in ({"duration_s": 0.0}, {"rate_hz": 0.0}, {"duration_s": NAN})],
    (learn_activities, {"n_components": 0}, "1 to"), (learn_activities, {"n_components": 500}, "1 to"),
    (learn_activities, {"variance": 1.0}, "variance"), (learn_activities, {"angles": ["wing"]}, "wing"),
    (learn_activities, {"angles": []}, "angle"),
    (learn_walking, {"n_components": 0}, "components"), (learn_walking, {"n_components": 500}, "components"),
    (learn_walking, {"variance": 1.0}, "variance"), (learn_walking, {"scaling": "x"}, "scaling"),
    (learn_walking, {"torso_speed": "x"}, "torso_speed"), (learn_windows, {"scaling": "x"}, "scaling"),
    (learn_windows, {"angles": ("left_wing",)}, "left_wing"), (learn_windows, {"angles": ()}, "angles"),
    (learn_windows, {"window_frames": 0}, "window_frames"),
    (learn_windows, {"window_frames": 5000}, "at least 4 windows"),
    (learn_windows, {"rate_hz": 0.0}, "rate"),
]  # fmt: skip


@pytest.fixture(scope="module")
def makers():
    """Return each generator and learner with valid arguments."""
    walks = builtin_motions(n_subjects=3)
    return {
        walker: lambda **wrong: walker(average_subject(), **{"duration_s": 1.0, "rate_hz": 30.0, **wrong}),
        runner: lambda **wrong: runner(average_runner(), **{"duration_s": 1.0, "rate_hz": 30.0, **wrong}),
        learn_activities: lambda **wrong: learn_activities(activity_cycles(walks), **wrong),
        learn_walking: lambda **wrong: learn_walking(walks, **PAPER | wrong),
        learn_windows: lambda **wrong: learn_windows(walks, **wrong),
    }


@pytest.mark.parametrize(("make", "wrong", "message"), OPTIONS)
def test_an_invalid_option_is_named(makers, make, wrong, message):
    with pytest.raises(InputError, match=message):
        makers[make](**wrong)


@pytest.mark.parametrize(
    ("read", "wrong", "message"),
    [
        (database_motions, {"motions": "recorded"}, r"paths\.data"), (database_motions, {"motions": "cmu"}, "data"),
        (database_motions, {"motions": "bandai"}, r"paths\.data"), (database_motions, {"motions": "all"}, "all"),
        (training_motions, {"motions": "all", "subjects": ()}, "all"),
        (database_motions, {"motions": "builtin", "activities": ["dance"]}, "clips of dance, found 24 clips"),
        (activity_model, {"activities": ["swim"]}, "swim"),
    ],
)  # fmt: skip
def test_missing_motions_and_activities_are_named(read, wrong, message, tmp_path):
    data = {} if read is activity_model else {"data": None}
    with pytest.raises(InputError, match=message):
        read(**data, cache=str(tmp_path), **wrong)


def test_sequences_and_periods_that_do_not_match_are_rejected():
    for sequences, periods, message in (
        ([NOISE, NOISE[:, :1]], [40, 40], "same m"),
        ([NOISE], [40, 40], "one period"),
        ([NOISE * [1.0, NAN]], [40], "angle 1 has no valid sample"),
    ):
        with pytest.raises(InputError, match=message):
            align(sequences, periods)
