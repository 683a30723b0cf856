"""The end of a run adds the verdict, the states of the frames and the reprojection errors to its recording."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import components, static, values
from recording_steps import BODY, CAMERA, SPACE, steps

from workbench.body.kinematics import joints
from workbench.evaluation.verdict.run_findings import RunInputs
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.evaluation.verdict.run_verdict import Verdict, verdict
from workbench.recording.read.reader import read
from workbench.recording.write import outcome
from workbench.recording.write.outcome import reprojection_errors
from workbench.recording.write.recorder import Recorder
from workbench.utils.finding import Finding

LOST = Verdict((), Finding("lost", "from frame 3"), ("tracked", "tracked", "tracked", "lost", "lost", "tracked"))
OFFSET_PX = np.array([3.0, 4.0])


def recorded(path, run, metrics=lambda k: {}, run_verdict=None):
    """Record steps with their verdict; return the path and the measurements."""
    collector = MeasurementCollector(BODY)
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for k, step in enumerate(run):
            recorder.log(step, {})
            collector.add(step, metrics(k))
        recorder.set_verdict(run_verdict or verdict(collector.measurements(), RunInputs()), collector.measurements())
    return path, collector.measurements()


def test_the_verdict_is_recorded_as_text_property_and_states(tmp_path, monkeypatch):
    def expected_errors(k):
        return {"expected_error_arms_mm": 800.0 if k > 3 else 10.0}

    feet = np.array([[np.nan, 1.0], [np.nan, 1.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    monkeypatch.setattr(outcome, "stance", lambda *_: feet)
    path, _ = recorded(tmp_path / "run.rrd", steps(6, n_particles=20), expected_errors, LOST)
    properties = read(path).properties["verdict"]
    assert (properties["level"], properties["outcome"], properties["kind"]) == ("doubtful", "lost", "lost")
    assert "frame 3" in properties["message"]
    assert static(path, "/verdict", "TextDocument:text")[0].startswith("**doubtful**, because from frame 3")
    assert values(path, "/state/tracking", "StateChange:state") == ["tracked", "lost", "tracked"]
    assert values(path, "/state/large_expected_error", "StateChange:state") == ["none", "arms"]
    assert values(path, "/state/foot_left", "StateChange:state") == ["no gait", "stance", "swing"]
    assert values(path, "/state/foot_right", "StateChange:state") == ["stance", "swing", "stance"]


@pytest.mark.parametrize(("n_values", "is_curve", "is_sparse"), [(1, False, False), (2, True, True), (3, True, False)])
def test_metrics_of_two_frames_are_curves_and_those_of_less_than_half_of_the_frames_points(
    tmp_path, n_values, is_curve, is_sparse
):
    run = steps(6, n_particles=5)
    collector = MeasurementCollector(BODY)
    with Recorder(tmp_path / "run.rrd", BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for k, step in enumerate(run):
            recorder.log(step, {"ess": 5.0} | ({"mpjpe_px": 3.0} if k < n_values else {}))
            collector.add(step, {})
        recorder.set_verdict(LOST, collector.measurements())
        drawn = recorder._layout_input
    assert drawn is not None
    assert [name in drawn.metrics for name in ("ess", "mpjpe_px")] == [True, is_curve]
    assert ("mpjpe_px" in drawn.sparse) == is_sparse


@pytest.mark.parametrize(("every", "n", "style"), [(1, 8, "SeriesLines"), (4, 2, "SeriesPoints")])
def test_reprojection_errors_are_curves_or_points_where_few_frames_have_keypoints(tmp_path, every, n, style):
    """The steps have no truth; one of `every` frames has keypoints, at a distance of 5 px from the estimate."""

    def with_keypoints(k, step):
        pixels = CAMERA.project(joints(BODY.skeleton, step.expected_pose[None])[0]) + OFFSET_PX
        keypoints = np.column_stack([pixels, np.ones(len(pixels))]) if k % every == 0 else None
        views = (replace(step.frame.views[0], keypoints=keypoints),)
        return replace(step, frame=replace(step.frame, views=views, truth=None))

    run = [with_keypoints(k, step) for k, step in enumerate(steps(8, n_particles=5))]
    path, measurements = recorded(tmp_path / "run.rrd", run)
    errors_px, entity = reprojection_errors(measurements), f"/reprojection_error_px/{CAMERA.name}"
    assert list(errors_px) == [CAMERA.name, "forearm"]
    np.testing.assert_allclose(errors_px[CAMERA.name][::every], 5.0)
    assert (errors_px["forearm"][::every] > 5.0).all()
    np.testing.assert_allclose(values(path, entity, "Scalars:scalars"), np.full(n, 5.0))
    assert style in {name.partition(":")[0] for name in components(path)[entity, True]}
