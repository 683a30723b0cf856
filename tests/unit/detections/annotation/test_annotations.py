"""Annotations are written after every change, read from an existing file, and undone one by one."""

import numpy as np
import pytest

from workbench.detections.annotation.annotations import Annotations
from workbench.detections.joint_annotations import read_annotations
from workbench.utils.errors import InputError


def annotations_in(folder, n_frames=9, size=(640, 480)):
    return Annotations(folder / "annotations.csv", n_frames, size)


def test_the_file_has_the_format_of_the_datasets(tmp_path):
    annotations = annotations_in(tmp_path)
    annotations.put((4, "left_knee"), (100.25, 20.0, False))
    annotations.put((2, "neck"), (5.123, 6.0, True))
    path = tmp_path / "annotations.csv"
    assert path.read_text() == "frame,joint,u,v,visible\n2,neck,5.12,6,1\n4,left_knee,100.25,20,0\n"
    read = read_annotations(path)
    np.testing.assert_array_equal(read.frames, [2, 4])
    assert read.at(4)[1].sum() == 0


def test_an_existing_file_is_continued(tmp_path):
    annotations_in(tmp_path).put((4, "left_knee"), (100.25, 20.0, False))
    reopened = annotations_in(tmp_path)
    assert reopened.values == {(4, "left_knee"): (100.25, 20.0, False)}
    assert reopened.undo() is None  # changes of an earlier session are not undone
    reopened.put((4, "left_knee"), None)
    assert annotations_in(tmp_path).values == {}


def test_undo_reverts_the_latest_change(tmp_path):
    annotations = annotations_in(tmp_path)
    annotations.put((1, "neck"), (1.0, 1.0, True))
    annotations.put((1, "neck"), (2.0, 2.0, True))
    annotations.put((1, "neck"), None)
    assert [annotations.undo(), annotations.values[1, "neck"]] == [(1, "neck"), (2.0, 2.0, True)]
    assert [annotations.undo(), annotations.values[1, "neck"]] == [(1, "neck"), (1.0, 1.0, True)]
    annotations.undo()
    assert annotations.values == {}
    assert annotations.undo() is None


@pytest.mark.parametrize(
    ("change", "message"), [
        (((9, "neck"), (1.0, 1.0, True)), "no frame 9"), (((0, "nose"), (1.0, 1.0, True)), "unknown joint 'nose'"),
        (((0, "neck"), (640.0, 1.0, True)), "outside the image of 640×480"),
    ],
)  # fmt: skip
def test_a_rejected_change_has_no_effect(tmp_path, change, message):
    annotations = annotations_in(tmp_path)
    with pytest.raises(InputError, match=message):
        annotations.put(*change)
    assert not (tmp_path / "annotations.csv").exists()
    assert not annotations.values
    assert annotations.undo() is None


def test_an_annotation_that_cannot_be_written_is_not_added(tmp_path):
    folder = tmp_path / "removed"
    folder.mkdir()
    annotations = annotations_in(folder)
    folder.rmdir()
    with pytest.raises(InputError, match="cannot be written"):
        annotations.put((0, "neck"), (1.0, 1.0, True))
    assert not annotations.values
    assert annotations.undo() is None


def test_a_file_that_does_not_match_the_video_is_rejected(tmp_path):
    annotations_in(tmp_path).put((8, "neck"), (600.0, 1.0, True))
    with pytest.raises(InputError, match="do not match the video"):
        annotations_in(tmp_path, n_frames=5)
    with pytest.raises(InputError, match="do not match the video"):
        annotations_in(tmp_path, size=(320, 240))
    with pytest.raises(InputError, match="expected a folder"):
        annotations_in(tmp_path / "none")
    with pytest.raises(InputError, match="cannot be read"):
        Annotations(tmp_path, 9, (640, 480))


def test_a_file_with_points_that_would_be_lost_is_rejected(tmp_path):
    path = tmp_path / "joints.csv"
    path.write_text("frame,joint,u,v,visible\n0,neck,1,2,1\n0,left_toe,1,2,1\n")
    with pytest.raises(InputError, match="expected joints of the body alone, found left_toe"):
        Annotations(path, 3, (10, 10))
    assert "left_toe" in path.read_text()
