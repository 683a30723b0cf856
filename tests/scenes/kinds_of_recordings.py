"""A recording of every kind, written by the current code."""

from dataclasses import replace

import numpy as np
from recording_steps import BODY, SPACE, steps

from workbench.core.study import Bars, StudyResult
from workbench.recording.study.study_recorder import record_study
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.recorder import Recorder


def write_kinds(folder):
    """Write recordings of images, of a synthesis without images and truth, and of a study; return the folder."""
    run = list(steps(3, n_particles=20))
    _record(folder / "images.rrd", "images", run, sigma=0.1)
    without_images = [replace(step, frame=replace(step.frame, views=(), truth=None)) for step in run]
    _record(folder / "synthesis.rrd", "synthesis", without_images, sigma="wide")  # a string, not a number
    with RecordingFile(folder / "study.rrd", **_labels("study", sigma=True)) as file:
        figure = Bars("c1", np.arange(-1.0, 2.0), np.ones(3) / 3, "σ", np.ones(3) / 3)
        record_study(file, StudyResult({"n_cycles": 93, "explained_variance": 0.5}, (figure,), "A note."))
    return folder


def _labels(name, **settings):
    origin = {"experiment": name, "seed": 0, "choices": [f"prior={name}", "body=dataset"]}
    return {"run_id": name, "config_yaml": "seed: 0", "provenance": origin, "settings": {"seed": 0, **settings}}


def _record(path, name, run, **settings):
    with Recorder(path, BODY, SPACE, **_labels(name, **settings)) as recorder:
        for step in run:
            recorder.log(step, {"mpjpe_abs_mm": 1.0} if step.frame.truth else {})
        recorder.set_result({"mpjpe_abs_mm": 1.0, "n_frames": len(run)})
