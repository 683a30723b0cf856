from workbench.core.likelihood import Evaluation


class Upright:
    """People lean little: a Gaussian over pitch and roll, whatever the images show."""

    notes, diagnostics = (), {}

    def __init__(self, *, sigma_rad: float = 0.1) -> None:
        self.sigma_rad = sigma_rad

    def prepare(self, previous, frame):
        return self

    def evaluate(self, previous_pose, pose):
        return Evaluation(-0.5 * ((pose[:, 4:6] / self.sigma_rad) ** 2).sum(axis=1))

    def update(self, expected_pose):
        return self
