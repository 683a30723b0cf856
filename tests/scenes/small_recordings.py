"""Runs with a small recording of an image and a curve; the texts may be untrusted."""

import json

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from run_folders import summary, write_run

from workbench.recording.write.file import RecordingFile

JPEG = cv2.imencode(".jpg", np.zeros((6, 8), dtype=np.uint8))[1].tobytes()


def record(path, run_id="a run", experiment="walk_straight", **fields):
    """Write a recording with the contents of `summary` and return its path."""
    contents = summary(**fields)
    origin = {**contents["provenance"], "experiment": experiment, "seed": contents["seed"], **fields.get("origin", {})}
    labels = {"config_yaml": json.dumps(contents["settings"]), "settings": contents["settings"], "provenance": origin}
    with RecordingFile(path, run_id=run_id, **labels) as file:
        file.stream.send_blueprint(rrb.Blueprint(rrb.Spatial2DView(origin="world/camera/image"), auto_views=False))
        for frame in range(3):
            file.stream.set_time("frame", sequence=frame)
            file.stream.log("metrics/mpjpe_abs_mm", rr.Scalars(float(frame)))
            file.stream.log("world/camera/image", rr.EncodedImage(contents=JPEG, media_type="image/jpeg"))
        file.send_numbers("metrics", {name: value for name, value in contents["metrics"].items() if value is not None})
    return path


def write_recorded_run(folder, run_id, **fields):
    """Write a run folder with a recording and return it."""
    write_run(folder, **{name: value for name, value in fields.items() if name != "origin"})
    record(folder / "run.rrd", run_id, **fields)
    return folder
