"""What every scene is made of in which one person moves before a still camera."""

from dataclasses import dataclass
from typing import Any

from workbench.core.checks import FINITE, POSITIVE, Range, at_least, check

_RANGES = {
    "n_frames": at_least(2), "first_frame": at_least(0), "rate_hz": POSITIVE, "width": at_least(32),
    "height": at_least(32), "focal_px": at_least(1), "view_deg": FINITE, "seed": at_least(0),
}  # fmt: skip


@dataclass(kw_only=True, eq=False)
class Scene:
    """A person's motion in n_frames frames at rate_hz, and a camera that sees it.

    motion: a name as `mocap.named.find_motion` knows them, or a list of names that take even turns (`splice.splice`).
    data: the folder that holds cmu/ and bandai/. path: "straight" or "circle", of the builtin walker. first_frame: of
    the (first) motion, counted at rate_hz. A level camera of width × height pixels and focal length focal_px looks at
    view_deg (degrees) to the motion's direction: 90 from the side, 180 from ahead. seed: of all that is drawn, and of
    the builtin walker.
    """

    motion: Any = "builtin"  # a name or a list of them, for which a schema has no other type
    data: str | None = None
    path: str = "straight"
    n_frames: int = 28
    first_frame: int = 0
    rate_hz: float = 14.0
    width: int = 640
    height: int = 480
    focal_px: float = 700.0
    view_deg: float = 90.0
    seed: int = 0

    @property
    def kind(self) -> str:
        """Tell what messages call the dataset, which is its class in lower case."""
        return type(self).__name__.lower()

    def source(self, rate_hz: float) -> dict[str, Any]:
        """Return what tells `find_motion` which of a motion's versions the scene shows, at a rate."""
        return {"data": self.data, "rate_hz": rate_hz, "path": self.path, "seed": self.seed}

    def check(self, **expected: Range) -> None:
        """Raise InputError for the first number that is not in its range, of those that all scenes share and others."""
        check(self.kind, self, **(_RANGES | expected))
