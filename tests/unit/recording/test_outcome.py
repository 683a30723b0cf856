"""What a run's end adds to its recording: the verdict, lanes of states, and residuals from the keypoints."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import components, static, values
from recording_steps import BODY, CAMERA, SPACE, steps

from workbench.body.kinematics import joints
from workbench.evaluation.finding import Finding
from workbench.evaluation.run_findings import RunInputs
from workbench.evaluation.run_measurements import MeasurementCollector
from workbench.evaluation.verdict import Verdict, verdict
from workbench.recording.read.reader import read
from workbench.recording.write.outcome import reprojection_errors
from workbench.recording.write.recorder import Recorder

LOST = Verdict((), Finding("lost", "from frame 3"), ("tracked", "tracked", "tracked", "lost", "lost", "tracked"))
OFF_PX = np.array([3.0, 4.0])


def recorded(path, run, metrics=lambda k: {}, told=None):
    """Record steps with their verdict; returns the path and the measurements."""
    collector = MeasurementCollector(BODY)
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for k, step in enumerate(run):
            recorder.log(step, {})
            collector.add(step, metrics(k))
        recorder.set_verdict(told or verdict(collector.measurements(), RunInputs()), collector.measurements())
    return path, collector.measurements()


def test_the_verdict_is_a_text_a_property_and_lanes(tmp_path):
    doubts = lambda k: {"expected_error_arms_mm": 800.0 if k > 3 else 10.0}  # noqa: E731
    path, _ = recorded(tmp_path / "run.rrd", steps(6, n_particles=20), doubts, LOST)
    found = read(path).properties["verdict"]
    assert (found["level"], found["outcome"], found["kind"]) == ("doubtful", "lost", "lost")
    assert "frame 3" in found["message"]
    assert static(path, "/verdict", "TextDocument:text")[0].startswith("**doubtful**, because from frame 3")
    assert values(path, "/state/tracking", "StateChange:state") == ["tracked", "lost", "tracked"]
    assert values(path, "/state/large_expected_error", "StateChange:state") == ["none", "arms"]


@pytest.mark.parametrize(("every", "n", "style"), [(1, 8, "SeriesLines"), (4, 2, "SeriesPoints")])
def test_residuals_are_curves_and_those_of_few_frames_marks(tmp_path, every, n, style):
    """Of steps without truth whose keypoints lie 5 px from the estimate in every so many frames."""

    def seen(k, step):
        pixels = CAMERA.project(joints(BODY.skeleton, step.expected_pose[None])[0]) + OFF_PX
        marks = np.column_stack([pixels, np.ones(len(pixels))]) if k % every == 0 else None
        views = (replace(step.frame.views[0], keypoints=marks),)
        return replace(step, frame=replace(step.frame, views=views, truth=None))

    run = [seen(k, step) for k, step in enumerate(steps(8, n_particles=5))]
    path, measured = recorded(tmp_path / "run.rrd", run)
    found, entity = reprojection_errors(measured), f"/reprojection_error_px/{CAMERA.name}"
    assert list(found) == [CAMERA.name, "forearm"]
    np.testing.assert_allclose(found[CAMERA.name][::every], 5.0)
    assert (found["forearm"][::every] > 5.0).all()
    np.testing.assert_allclose(values(path, entity, "Scalars:scalars"), np.full(n, 5.0))
    assert style in {name.partition(":")[0] for name in components(path)[entity, True]}
