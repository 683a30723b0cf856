"""The joints that a recording's keypoints show."""

from pathlib import Path

import numpy as np

from workbench.recording.read.chunks import cells, flat, read_chunks, sound, static_values
from workbench.recording.write.images import KEYPOINT_RADIUS

_RADII, _LABELS, _PLACES, _SIZE = "Points2D:radii", "Points2D:labels", "Points2D:positions", "Pinhole:resolution"


def keypoint_weights(path: Path) -> dict[str, float]:
    """Return the largest weight of each joint's keypoints inside an image, of all frames and cameras, by joint.

    {} for a recording without keypoints. Raises InputError for a file that is no recording.
    """
    table = cells(path, ["/world/**"], components=(_RADII, _LABELS, _PLACES))
    views = {entity.removesuffix("/keypoints"): each for entity, each in table.items() if entity.endswith("/keypoints")}
    sizes = static_values(read_chunks(path, ["/world/**"], components=(_SIZE,)))
    largest: dict[str, float] = {}
    with sound(path):
        for image, columns in views.items():
            size = flat(next(iter(each[_SIZE] for key, each in sizes.items() if image.startswith(key)), None))
            for frame, radii in columns[_RADII].items():
                places, weights = flat(columns[_PLACES][frame]).reshape(-1, 2), (flat(radii) / KEYPOINT_RADIUS) ** 2
                inside = ((places >= 0.0) & (places < (size if size.size else np.inf))).all(axis=1)
                for name, weight in zip(columns[_LABELS][frame].as_py(), inside * weights, strict=True):
                    largest[name] = max(largest.get(name, 0.0), float(weight))
    return largest
