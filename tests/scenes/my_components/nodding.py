import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.capabilities import IMAGES, START, component_traits
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth, View


class Nodding:
    """A person who leans back and forth in front of a grey wall."""

    traits = component_traits(IMAGES, START)

    def __init__(self, *, n_frames: int = 10, height_m: float = 1.75) -> None:
        self.shape, self.n_frames = from_height(height_m), n_frames
        self.camera = plain_camera(160, 120, 175.0, (0.0, -5.0, 1.0), (0.0, 0.0, 1.0))
        start = self.pose(0)
        self.info = SequenceInfo(
            "nodding", n_frames, cameras=(self.camera,), shape=self.shape, initial_pose=start, rate_hz=30.0
        )

    def pose(self, index):
        pose = np.zeros(25)
        pose[2], pose[4] = 0.95, 0.1 * np.sin(index / 5)
        return pose

    def frames(self):
        grey = np.full((120, 160), 128, np.uint8)
        skeleton = person(self.shape).skeleton
        for i in range(self.n_frames):
            pose = self.pose(i)
            truth = Truth(pose=pose, joints=joints(skeleton, pose[None])[0])
            yield Frame(i, i / 30.0, (View(self.camera, grey),), truth)
