"""`workbench check-calibration`: check a calibration against images and detected people before tracking."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from omegaconf import DictConfig, OmegaConf

from workbench.cameras.calibration_findings import CalibrationCheck, check_calibration
from workbench.cameras.observed_joints import ObservedJoints
from workbench.cameras.overlay import draw_overlay
from workbench.datasets.joint_observation import observe_joints
from workbench.experiment.config import schema
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.options import allow_packages, packages_in
from workbench.recording.write import styles
from workbench.utils.atomic_write import write_files
from workbench.utils.errors import InputError
from workbench.utils.finding import NOTE, TRUSTWORTHY, Finding, conclusion

_SIGNS = {TRUSTWORTHY: "fits", NOTE: "note"}


def check_of_dataset(
    overrides: Annotated[list[str], typer.Argument(metavar="KEY=VALUE", help="The dataset, as of a run.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="Folder of the images.")] = Path(
        "check-calibration"
    ),
) -> int:
    """Check a calibration against the images and the people in them before tracking.

    Draws the floor, the axes, the vertical and the joints into a frame of
    every camera and prints the findings and the verdict: trustworthy,
    doubtful or not usable, which end with exit code 0, 1 and 1.

    Examples:
      workbench check-calibration experiment=balance_4cam paths.data=DATA
      workbench check-calibration dataset=video dataset.source=walk.mp4 \\
        dataset.calibration_file=camera.toml dataset.keypoints=annotations.csv \\
        body=height body.height_m=1.65
    """
    config = _composed(overrides)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        observed = observe_joints(build(config.dataset))
    height_m = None if config.body is None else config.body.get("height_m")
    check = check_calibration(observed, None if height_m is None else float(height_m))
    files = _draw(observed, check, output)
    warned = [Finding("", str(item.message), NOTE) for item in caught if issubclass(item.category, UserWarning)]
    for finding in (*warned, *check.findings):
        print(f"{_SIGNS.get(finding.level, finding.level):<12}{finding.message}")
    print(f"drawn in {', '.join(map(str, files))}\nverdict: {conclusion(check.findings)}")
    return 0 if check.level == TRUSTWORTHY else 1


def _composed(overrides: Sequence[str]) -> DictConfig:
    """Return the composed configuration; InputError if it has no complete dataset."""
    allow_packages(packages_in(overrides))
    chosen = {text.partition("=")[0] for text in overrides}
    if not chosen & {"dataset", "experiment"}:
        raise InputError("expected a dataset, such as dataset=video dataset.source=walk.mp4, or an experiment")
    config = schema.composed([*([] if "experiment" in chosen else ["experiment=custom"]), *overrides])
    if config.dataset is None:
        raise InputError("expected an experiment with a dataset, found none")
    if missing := sorted(OmegaConf.missing_keys(config.dataset)):
        raise InputError(f"dataset: {', '.join(missing)} required; add dataset.{missing[0]}=…")
    return config


def _draw(observed: ObservedJoints, check: CalibrationCheck, folder: Path) -> list[Path]:
    """Write an image for each camera, named after it; return the files."""
    files = dict[str, bytes]()
    for v, (camera, image) in enumerate(zip(observed.cameras, observed.images, strict=True)):
        empty = np.full((observed.keypoints.shape[2], 3), np.nan)
        marks, joints = (
            values[observed.best] if len(values) else empty for values in (observed.keypoints[v], check.joints)
        )
        overlay = draw_overlay(camera, image, marks, joints, check.floor_m or 0.0, styles.ESTIMATE, styles.KEYPOINT)
        name = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in camera.name) or "camera"
        files[f"{name}.png"] = cv2.imencode(".png", overlay[..., ::-1])[1].tobytes()
    return write_files(folder, files)
