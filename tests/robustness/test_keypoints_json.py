"""Detected keypoints in OpenPose's JSON: random damage, deep lists, places beyond any image."""

import json

import pytest
from damage import refusal, withstands
from sound_files import written

from workbench.motion.formats.openpose import read_openpose

SOUND = json.dumps({"people": [{"pose_keypoints_2d": [float(k % 7) for k in range(75)]}]})
BAD = {
    "lists in one another": "[" * 100_000, "mappings in one another": '{"a":' * 100_000, "digits": "1" * 5000,
    "no list": '{"people": 3}', "no points": '{"people": [{}]}', "half a point": SOUND.replace("0.0, ", "", 1),
    "texts": SOUND.replace("1.0", '"a"'), "infinity": SOUND.replace("1.0", "1e400"), "nan": SOUND.replace("1.0", "NaN"),
    "far away": SOUND.replace("1.0", "1e8"), "no text": b"\xff\xfe\x00",
    "a large number": SOUND.replace("1.0", "9" * 400),
}  # fmt: skip


def read_file(path):
    return read_openpose(path.parent)


def test_random_damage(tmp_path):
    withstands(read_file, written(tmp_path / "a_1.json", SOUND), 200)


@pytest.mark.parametrize("kind", BAD)
def test_a_defect_is_refused_with_its_file(tmp_path, kind):
    assert "a_1.json: expected" in refusal(read_file, written(tmp_path / "a_1.json", BAD[kind]))
