"""What every scene is made of in which one person moves before a still camera."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.errors import InputError

AT_LEAST: Mapping[str, float] = {"n_frames": 2, "first_frame": 0, "width": 32, "height": 32, "focal_px": 1.0, "seed": 0}


@dataclass(kw_only=True, eq=False)
class Scene:
    """A person's motion in n_frames frames at rate_hz, and a camera that sees it.

    motion: a name as `mocap.sources.find_motion` knows them, or a list of names that take even turns (`splice.splice`).
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

    def check(self, **at_least: float) -> None:
        """Raise InputError for a number below what is the least, of those given and those that all scenes share."""
        for name, least in {**AT_LEAST, **at_least}.items():
            if not least <= getattr(self, name) < np.inf:
                raise InputError(f"{self.kind}: {name} must be at least {least}, found {getattr(self, name)}")
        if not 0.0 < self.rate_hz < np.inf:
            raise InputError(f"{self.kind}: rate_hz must be positive, found {self.rate_hz}")
        if not np.isfinite(self.view_deg):
            raise InputError(f"{self.kind}: view_deg must be an angle in degrees, found {self.view_deg}")
