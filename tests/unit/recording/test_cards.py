"""What a gallery finds in a recording to show on its card."""

import cv2
import numpy as np
import rerun as rr

from workbench.recording.write.cards import preview_of
from workbench.recording.write.file import RecordingFile

PNG = cv2.imencode(".png", np.zeros((6, 8), dtype=np.uint8))[1].tobytes()


def test_a_preview_is_of_what_a_camera_saw(tmp_path):
    with RecordingFile(tmp_path / "run.rrd", run_id="a", config_yaml="{}", settings={}, provenance={}) as file:
        file.stream.set_time("frame", sequence=0)
        for place in ("posterior/pictures/knee/mass", "world/right/image", "world/left/image"):
            file.stream.log(place, rr.EncodedImage(contents=PNG, media_type="image/png"))
    assert preview_of(tmp_path / "run.rrd") == (["/world/left/image", "/world/right/image"], False)


def test_a_recording_that_was_cut_off_has_none(tmp_path):
    (tmp_path / "run.rrd").write_bytes(b"RRF2")
    assert preview_of(tmp_path / "run.rrd") == ([], False)
