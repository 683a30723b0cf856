"""World landmarks of a detector, and the smallest depths of bones by these, which resolve the ambiguity of a single
camera.

A bone that points towards the camera has the same image as one that points away. World landmarks select between them:
their sign is right in 80 to 93 % of the limbs over 8 cm in depth. Their magnitude is too small by 20 to 50 % in all
frames. It is therefore a lower bound: as a value, limbs would appear less foreshortened and the person further away.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.observations import Keypoints, Observed
from workbench.utils.arrays import FloatArray, IntArray

MIN_DEPTH_M = 0.08
"""Depth by the landmarks below which a bone's sign is not used: about their standard deviation."""
_SIDE_BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"), ("hip", "shoulder"))
BONES = (
    *((f"{side}_{first}", f"{side}_{last}") for side in ("left", "right") for first, last in _SIDE_BONES),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
)
"""Pairs of joints at a constant distance."""
_Row = tuple[int, int, FloatArray, float, float]


@dataclass(frozen=True, eq=False)
class DepthArrays:
    """Bones of T frames with their smallest depth: the residual is whitening · min(d · (x_last − x_first) − least, 0).

    first: (T + 1,) index of each frame's first bone. ends: (K, 2) first and last joint. directions: (K, 3) unit d along
    the line from the camera to the person, away from the camera if the last joint is deeper by the landmarks.
    whitening: (K,) inverse standard deviations, 1/m. least: (K,) depths by the landmarks, m.
    """

    first: IntArray
    ends: IntArray
    directions: FloatArray
    whitening: FloatArray
    least: FloatArray

    @staticmethod
    def of(skeleton: Skeleton, observations: Sequence[Observed], sigma_m: float) -> "DepthArrays":
        """Return the bones with a depth above MIN_DEPTH_M by the world landmarks of T frames.

        A bone's depth is its length in the skeleton times the sine of its inclination by the landmarks, whose own scale
        is not used.

        Parameters
        ----------
        sigma_m : standard deviation at weight 1, m; it is sigma_m / √weight for the bone's lower weight.
        """
        bones = [(skeleton.joint(a), skeleton.joint(b)) for a, b in BONES]
        rest = joints(skeleton, np.zeros((1, len(skeleton.dof_names))))[0]
        lengths = {(a, b): float(np.linalg.norm(rest[b] - rest[a])) for a, b in bones}
        frames = [[row for view in frame.keypoints for row in _rows(view, lengths, sigma_m)] for frame in observations]
        rows = [row for frame in frames for row in frame]
        return DepthArrays(
            first=np.concatenate([[0], np.cumsum([len(frame) for frame in frames])]).astype(np.int64),
            ends=np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2),
            directions=np.array([row[2] for row in rows]).reshape(-1, 3),
            whitening=np.array([row[3] for row in rows]),
            least=np.array([row[4] for row in rows]),
        )

    @staticmethod
    def none(n_frames: int) -> "DepthArrays":
        """Return those of frames without world landmarks."""
        first, ends = np.zeros(n_frames + 1, np.int64), np.empty((0, 2), np.int64)
        return DepthArrays(first, ends, np.empty((0, 3)), np.empty(0), np.empty(0))

    def select_frames(self, frames: IntArray) -> "DepthArrays":
        """Return the bones of the frames with these indices."""
        sizes = np.diff(self.first)[frames]
        k = np.concatenate([np.empty(0, np.int64), *(np.arange(self.first[t], self.first[t + 1]) for t in frames)])
        first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        return DepthArrays(first, self.ends[k], self.directions[k], self.whitening[k], self.least[k])

    @property
    def arrays(self) -> tuple[IntArray | FloatArray, ...]:
        """Return the arrays in the kernels' order."""
        return self.first, self.ends, self.directions, self.whitening, self.least


def _rows(view: Keypoints, lengths: dict[tuple[int, int], float], sigma_m: float) -> Iterator[_Row]:
    """Yield ends, direction, inverse standard deviation and smallest depth of the bones with landmarks at both ends."""
    if view.world_landmarks is None:
        return
    direction = view.camera.directions(view.camera.undistorted(view.detections[:, :2]).mean(axis=0))
    row_of = {int(joint): k for k, joint in enumerate(view.joints)}
    for (a, b), length in lengths.items():
        if a in row_of and b in row_of:
            bone = view.world_landmarks[row_of[b]] - view.world_landmarks[row_of[a]]
            size, weight = float(np.linalg.norm(bone)), float(view.detections[[row_of[a], row_of[b]], 2].min())
            depth_m = length * float(bone[2]) / size if size > 0.0 else 0.0
            if abs(depth_m) > MIN_DEPTH_M:
                yield a, b, np.sign(depth_m) * direction, np.sqrt(weight) / sigma_m, abs(depth_m)


def landmark_places(skeleton: Skeleton, view: Keypoints, mirrored: bool = False) -> FloatArray:
    """Return the world landmarks (J, 3) of a view that has some, along the world's axes, NaN for joints without;
    mirrored: reflected in depth."""
    assert view.world_landmarks is not None
    direction = view.camera.directions(view.camera.undistorted(view.detections[:, :2]).mean(axis=0))
    landmarks = view.world_landmarks * [1.0, 1.0, -1.0 if mirrored else 1.0]
    places = np.full((len(skeleton.names), 3), np.nan)
    places[view.joints] = landmarks @ view.camera.viewing_axes(direction)
    return places
