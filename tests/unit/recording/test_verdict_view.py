"""The verdict on the page: its first line, lanes of states, and no panel of what says nothing or of a single frame."""

from dataclasses import replace

import numpy as np
from layouts import SHOWN, laid_out
from recording_steps import BODY, SPACE, steps
from rerun.chunk import RrdReader

from workbench.evaluation.evidence import Evidence
from workbench.evaluation.verdict import Finding, RunInputs, Verdict, verdict
from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder

N = 6
LOST = Verdict((), Finding("lost", "from frame 3"), ("held", "held", "held", "lost", "lost", "held"))


def recorded(path, told=LOST):
    evidence = Evidence(BODY)
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}, constant=("ess",)) as recorder:
        for k, step in enumerate(steps(N, n_particles=20)):
            recorder.log(step, {"error_abs_mm": 1.0})
            evidence.add(step, {"doubt_arms_mm": 80.0 if k > 3 else 10.0})
        recorder.set_verdict(told, evidence.measured())
    return path


def texts(path, entity, component):
    found = []
    for chunk in RrdReader(path).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        found += [
            each[0] for name in batch.schema.names if name == component for each in batch.column(name).to_pylist()
        ]
    return found


def test_the_verdict_is_the_first_panel_a_property_and_lanes(tmp_path):
    assert laid_out(SHOWN)[next(iter(laid_out(SHOWN)))].origin == "/verdict"
    path = recorded(tmp_path / "run.rrd")
    verdict = read(path).properties["verdict"]
    assert verdict["kind"] == "lost"
    assert "frame 3" in verdict["sentence"]
    assert "lost" in texts(path, "/verdict", "TextDocument:text")[-1]
    assert texts(path, "/state/person", "StateChange:state") == ["held", "lost", "held"]
    assert texts(path, "/state/do_not_trust", "StateChange:state")[-1] == "arms"
    lanes = replace(SHOWN, lanes=("person", "do_not_trust"))
    assert len(laid_out(lanes)) == len(laid_out(SHOWN)) + 1


def test_feet_that_stand_are_lanes(tmp_path):
    path = tmp_path / "run.rrd"
    evidence = Evidence(BODY)
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in steps(24, n_particles=5):
            recorder.log(replace(step, expected_pose=step.frame.truth.pose), {})
            evidence.add(replace(step, expected_pose=step.frame.truth.pose), {})
        recorder.set_verdict(verdict(evidence.measured(), RunInputs()), evidence.measured())
    found = [texts(path, f"/state/foot_{side}", "StateChange:state") for side in ("left", "right")]
    assert set(found[0] + found[1]) == {"stands", "swings"}
    assert found[0] != found[1]


def test_what_is_the_same_in_all_such_runs_has_no_panel():
    without = laid_out(replace(SHOWN, constant=frozenset({"ess"}))).values()
    assert not [view for view in without if "metrics/ess" in f"{view.origin} {view.contents}"]


def test_evidence_of_a_few_frames_is_judged():
    evidence = Evidence(BODY)
    for step in steps(N, n_particles=20):
        evidence.add(step, {"error_abs_mm": 20.0})
    found = verdict(evidence.measured(), RunInputs())
    assert found.kind == "held"
    assert len(found.states) == N
    assert np.isnan(evidence.measured().off_px).all()
