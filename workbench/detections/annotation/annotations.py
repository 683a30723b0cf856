"""Annotations of one video, set, removed and undone, and written to their file after every change."""

from pathlib import Path
from typing import Any

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.joint_annotations import COLUMNS, read_annotations
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

_Annotation = tuple[float, float, bool]
"""u and v, px, where (0, 0) is the centre of the top left pixel, and whether the joint is visible."""
Place = tuple[int, str]
"""A frame's number and a joint's name."""


class Annotations:
    """Annotations of a video by frame and joint, sorted, and the CSV file that holds them."""

    def __init__(self, path: Path, n_frames: int, size: tuple[int, int]) -> None:
        """Open the annotations of a video of n_frames frames of a size (width, height), px, and continue an existing
        file; raises InputError as `read_annotations`, for annotations of another video, and for a missing folder."""
        if not path.parent.is_dir():
            raise InputError(f"{path}: expected a folder to write to, found none")
        self.path, self.n_frames, self.size = path, n_frames, size
        self.values: dict[Place, _Annotation] = {}
        self._undo_stack: list[tuple[Place, _Annotation | None]] = []
        try:
            content = path.read_bytes().strip() if path.exists() else b""
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
        if content in (b"", ",".join(COLUMNS).encode()):  # no annotations, or all of them have been removed
            return
        joints = read_annotations(path)
        if joints.other_points:  # writing the file would remove them
            points = ", ".join(joints.other_points)
            raise InputError(f"{path}: expected joints of the body alone, found {points}; annotate in another file")
        for row, j in np.argwhere(np.isfinite(joints.pixels[..., 0])):
            place, (u, v) = (int(joints.frames[row]), JOINT_NAMES[j]), joints.pixels[row, j].tolist()
            self.values[place] = u, v, bool(joints.visible[row, j])
            try:
                self._check(place, self.values[place])
            except InputError as error:
                raise InputError(f"{path}: annotations do not match the video: {error}") from None

    def put(self, place: Place, annotation: _Annotation | None) -> None:
        """Set an annotation, or remove it with None, and write the file; raises InputError for an unknown frame or
        joint, a pixel outside the image, and a file that cannot be written. Then nothing has changed."""
        self._check(place, annotation)
        before = self.values.get(place)
        self._replace(place, annotation)
        self._undo_stack.append((place, before))

    def undo(self) -> Place | None:
        """Undo the latest change since the file was opened, write the file, and return its place; None without one."""
        if not self._undo_stack:
            return None
        place, before = self._undo_stack[-1]
        self._replace(place, before)
        self._undo_stack.pop()
        return place

    def by_frame(self) -> dict[int, dict[str, _Annotation]]:
        """Return the annotations by joint by frame, in order."""
        frames: dict[int, dict[str, _Annotation]] = {}
        for (frame, joint), annotation in self.values.items():
            frames.setdefault(frame, {})[joint] = annotation
        return frames

    def _check(self, place: Place, annotation: _Annotation | None) -> None:
        if not 0 <= place[0] < self.n_frames:
            raise InputError(f"no frame {place[0]}, expected one of 0 to {self.n_frames - 1}")
        if place[1] not in JOINT_NAMES:
            raise InputError(f"unknown joint {place[1]!r}, expected one of {', '.join(JOINT_NAMES)}")
        if annotation and not all(-0.5 <= x <= n - 0.5 for x, n in zip(annotation[:2], self.size, strict=True)):
            u, v, _ = annotation
            raise InputError(f"({u:g}, {v:g}) lies outside the image of {self.size[0]}×{self.size[1]} px")

    def _replace(self, place: Place, annotation: _Annotation | None) -> None:
        changed = {key: value for key, value in self.values.items() if key != place}
        if annotation is not None:
            changed[place] = annotation
        changed = {key: changed[key] for key in sorted(changed, key=lambda key: (key[0], JOINT_NAMES.index(key[1])))}
        rows = [_row(place, value) for place, value in changed.items()]
        with whole_file(self.path) as part:
            part.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n", encoding="utf-8")
        self.values = changed


def parse_annotation(values: Any) -> tuple[Place, _Annotation | None]:
    """Parse {frame, joint, u, v, visible}, where null for u and v removes; raises InputError for anything else."""
    match values:
        case {"frame": int(frame), "joint": str(joint), "u": None, "v": None} if not isinstance(frame, bool):
            return (frame, joint), None
        case {"frame": int(frame), "joint": str(joint), "u": float() | int(), "v": float() | int(), "visible": bool()}:
            u, v = float(values["u"]), float(values["v"])
            if not isinstance(frame, bool) and np.isfinite([u, v]).all():
                return (frame, joint), (u, v, values["visible"])
    raise InputError("expected a frame number, a joint name, two numbers of pixels or null, and true or false")


def _row(place: Place, annotation: _Annotation) -> str:
    (frame, joint), (*pixel, visible) = place, annotation
    u, v = (f"{value:.2f}".rstrip("0").rstrip(".") for value in pixel)
    return f"{frame},{joint},{u},{v},{int(visible)}"
