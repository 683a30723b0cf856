"""What cameras tell of a run without truth: how far the estimate is from each one's keypoints."""

from dataclasses import replace

import numpy as np
from recording_steps import BODY, CAMERA, SPACE, steps
from rerun.chunk import RrdReader

from workbench.body.kinematics import joints
from workbench.evaluation.evidence import Evidence
from workbench.evaluation.verdict import RunInputs, verdict
from workbench.recording.write.outcome import residuals
from workbench.recording.write.recorder import Recorder

OFF_PX = np.array([3.0, 4.0])


def seen(every=1):
    """Steps without truth whose keypoints lie 5 px beside the estimate in every so many frames."""
    for k, step in enumerate(steps(8, n_particles=5)):
        view = step.frame.views[0]
        pixels = CAMERA.project(joints(BODY.skeleton, step.expected_pose[None])[0]) + OFF_PX
        marks = np.column_stack([pixels, np.ones(len(pixels))]) if k % every == 0 else None
        yield replace(step, frame=replace(step.frame, views=(replace(view, keypoints=marks),), truth=None))


def recorded(path, every):
    evidence = Evidence(BODY)
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in seen(every):
            recorder.log(step, {})
            evidence.add(step, {})
        recorder.set_verdict(verdict(evidence.measured(), RunInputs()), evidence.measured())
    chunks = list(RrdReader(path).store().stream().filter(content=f"/residual_px/{CAMERA.name}").to_chunks())
    batches = [chunk.to_record_batch() for chunk in chunks]
    values = [
        v[0] for b in batches if "Scalars:scalars" in b.schema.names for v in b.column("Scalars:scalars").to_pylist()
    ]
    return values, {name.partition(":")[0] for b in batches for name in b.schema.names}


def test_residuals_are_distances_from_the_keypoints():
    evidence = Evidence(BODY)
    for step in seen():
        evidence.add(step, {})
    found = residuals(evidence.measured())
    np.testing.assert_allclose(found[CAMERA.name], 5.0)
    assert list(found) == [CAMERA.name, "forearm"]
    assert (found["forearm"] > 5.0).all()


def test_residuals_are_curves_and_those_of_few_frames_marks(tmp_path):
    values, looks = recorded(tmp_path / "all.rrd", 1)
    np.testing.assert_allclose(values, np.full(8, 5.0))
    assert "SeriesLines" in looks
    values, looks = recorded(tmp_path / "few.rrd", 4)
    np.testing.assert_allclose(values, np.full(2, 5.0))
    assert "SeriesPoints" in looks
