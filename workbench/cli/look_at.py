"""workbench-look-at: does a calibration fit the images and the people in them? Told before anything is tracked.

Takes what the run would take, such as dataset=video dataset.source=walk.mp4 dataset.camera=camera.toml
dataset.keypoints=marks.csv body=height body.height_m=1.65, or experiment=balance_4cam; draws a floor, axes, up and the
joints into a frame of every camera, and says in sentences what fits.
"""

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.errors import InputError
from workbench.experiment import composition
from workbench.experiment.build import build
from workbench.experiment.parts import name_parts, parts_in
from workbench.files import whole_file
from workbench.looking.drawing import drawn
from workbench.looking.findings import Finding, Looked, fits, look
from workbench.looking.observed import Observed, observed

SIGNS = {True: "fits", False: "WRONG", None: "note"}
VERDICTS = {
    True: "the calibration fits", False: "the calibration does not fit",
    None: "nothing tells whether the calibration fits: mark joints, and look at the pictures",
}  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Look at a dataset. Returns 0, 1 when something does not fit, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="workbench-look-at", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", metavar="KEY=VALUE", nargs="+", help="the dataset, as for a run")
    parser.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=Path("look-at"), help="for the pictures")
    arguments = parser.parse_intermixed_args(argv)
    try:
        config = composed(arguments.words)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            seen = observed(build(config.dataset))
        found = look(seen, _height(config))
        files = _draw(seen, found, arguments.output)
    except (InputError, HydraException, OmegaConfBaseException) as error:
        print(f"workbench-look-at: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    told = [Finding(str(warning.message), None) for warning in caught if issubclass(warning.category, UserWarning)]
    for finding in (*told, *found.findings):
        print(f"{SIGNS[finding.fits]:<6}{finding.sentence}")
    print(f"{VERDICTS[fits(found.findings)]}; drawn in {', '.join(map(str, files))}")
    return 1 if fits(found.findings) is False else 0


def composed(words: Sequence[str]) -> DictConfig:
    """Compose the configuration that these words of a command line choose; raises InputError where no dataset is."""
    name_parts(parts_in(words))
    chosen = {word.partition("=")[0] for word in words}
    if not chosen & {"dataset", "experiment"}:
        raise InputError("expected a dataset, such as dataset=video dataset.source=walk.mp4, or an experiment")
    config = composition.composed([*([] if "experiment" in chosen else ["experiment=custom"]), *words])
    if config.dataset is None:
        raise InputError("expected an experiment with a dataset, found none")
    if lacking := sorted(OmegaConf.missing_keys(config.dataset)):
        raise InputError(f"the dataset lacks {', '.join(lacking)}: say dataset.{lacking[0]}=…")
    return config


def _height(config: DictConfig) -> float | None:
    """Return the height, m, that the configuration tells of the person."""
    height = None if config.body is None else config.body.get("height_m")
    return None if height is None else float(height)


def _draw(seen: Observed, found: Looked, folder: Path) -> list[Path]:
    """Write a picture by camera, named for it."""
    files = []
    for v, (camera, image) in enumerate(zip(seen.cameras, seen.images, strict=True)):
        nothing = np.full((seen.marks.shape[2], 3), np.nan)
        marks, joints = (
            values[seen.shown] if len(seen.frames) else nothing for values in (seen.marks[v], found.joints)
        )
        picture = drawn(camera, image, marks, joints, found.floor_m or 0.0)
        name = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in camera.name) or "camera"
        files.append(folder / f"{name}.png")
        with whole_file(files[-1], parents=True) as part:
            part.write_bytes(cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes())
    return files
