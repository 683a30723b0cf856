"""workbench-look-at: check before tracking whether a calibration fits the images and the people in them.

It takes the arguments of the run, such as dataset=video dataset.source=walk.mp4 dataset.camera=camera.toml
dataset.keypoints=marks.csv body=height body.height_m=1.65, or experiment=balance_4cam, draws a floor, axes, up and the
joints into a frame of every camera, and prints what fits.
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

from workbench.camera_calibration.findings import CalibrationCheck, CalibrationFinding, check_calibration
from workbench.camera_calibration.observed_joints import ObservedJoints, observe_joints
from workbench.camera_calibration.overlay import draw_overlay
from workbench.experiment.config import schema
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.options import name_parts, parts_in
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

SIGNS = {True: "fits", False: "WRONG", None: "note"}
VERDICTS = {
    True: "the calibration fits", False: "the calibration does not fit",
    None: "it is unknown whether the calibration fits: annotate joints, and view the pictures",
}  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Check a dataset's calibration. Return 0, 1 where something does not fit, 2 for bad input."""
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
            seen = observe_joints(build(config.dataset))
        check = check_calibration(seen, _height(config))
        files = _draw(seen, check, arguments.output)
    except (InputError, HydraException, OmegaConfBaseException) as error:
        print(f"workbench-look-at: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    warned = [CalibrationFinding(str(each.message)) for each in caught if issubclass(each.category, UserWarning)]
    for finding in (*warned, *check.findings):
        print(f"{SIGNS[finding.fits]:<6}{finding.sentence}")
    print(f"{VERDICTS[check.fits]}; drawn in {', '.join(map(str, files))}")
    return 1 if check.fits is False else 0


def composed(words: Sequence[str]) -> DictConfig:
    """Compose the configuration of command-line arguments; raises InputError where it has no complete dataset."""
    name_parts(parts_in(words))
    chosen = {word.partition("=")[0] for word in words}
    if not chosen & {"dataset", "experiment"}:
        raise InputError("expected a dataset, such as dataset=video dataset.source=walk.mp4, or an experiment")
    config = schema.composed([*([] if "experiment" in chosen else ["experiment=custom"]), *words])
    if config.dataset is None:
        raise InputError("expected an experiment with a dataset, found none")
    if lacking := sorted(OmegaConf.missing_keys(config.dataset)):
        raise InputError(f"the dataset lacks {', '.join(lacking)}: give dataset.{lacking[0]}=…")
    return config


def _height(config: DictConfig) -> float | None:
    """Return the person's height, m, where the configuration has one."""
    height = None if config.body is None else config.body.get("height_m")
    return None if height is None else float(height)


def _draw(seen: ObservedJoints, check: CalibrationCheck, folder: Path) -> list[Path]:
    """Write a picture for each camera, with its name."""
    files = []
    for v, (camera, image) in enumerate(zip(seen.cameras, seen.images, strict=True)):
        nothing = np.full((seen.marks.shape[2], 3), np.nan)
        marks, joints = (values[seen.shown] if len(values) else nothing for values in (seen.marks[v], check.joints))
        picture = draw_overlay(camera, image, marks, joints, check.floor_m or 0.0)
        name = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in camera.name) or "camera"
        files.append(folder / f"{name}.png")
        with whole_file(files[-1], parents=True) as part:
            part.write_bytes(cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes())
    return files
