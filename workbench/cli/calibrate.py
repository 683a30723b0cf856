"""`workbench calibrate`: calibrate cameras from images of a checkerboard or of a person of known height."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from workbench.cameras import checkerboard, person_height
from workbench.cameras.camera_file import check_name, write_cameras
from workbench.detections.joint_annotations import read_annotations
from workbench.utils.decode import count_frames, decode
from workbench.utils.errors import InputError
from workbench.utils.input_path import expanded

_IMPRECISE = 0.02
"""Relative standard deviation of a focal length above which more images are requested."""

app = typer.Typer(add_completion=False)
_Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE.toml", help="The file to write.")]
_Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]


@app.callback()
def _calibrate() -> None:
    """Calibrate cameras from images of a checkerboard or of a person of known height.

    The file is an input of dataset.calibration_file; `workbench check-calibration`
    checks it.

    Examples:
      workbench calibrate board camera=board.mp4 --corners 9x6 --square-mm 25 -o camera.toml
      workbench calibrate height walk.mp4 annotations.csv --height-m 1.65 -o camera.toml
    """


@app.command("board")
def _board(
    sources: Annotated[list[str], typer.Argument(metavar="NAME=SOURCE", help="Videos or folders of images by camera.")],
    corners: Annotated[str, typer.Option(metavar="9x6", help="Inner corners across and down, one less than squares.")],
    square_mm: Annotated[float, typer.Option(metavar="MM", help="Side length of a square.")],
    output: _Output,
    floor: Annotated[
        int | None,
        typer.Option(
            metavar="IMAGE",
            help="Number (from 0) of an image in which the board lies on the floor; "
            "without it the first camera is assumed level.",
        ),
    ] = None,
    overwrite: _Overwrite = False,
) -> None:
    """Calibrate one or more cameras with a checkerboard.

    Examples:
      workbench calibrate board camera=board.mp4 --corners 9x6 \\
        --square-mm 25 -o camera.toml
      workbench calibrate board left=left.mp4 right=right.mp4 \\
        --corners 9x6 --square-mm 25 --floor 120 -o cameras.toml
    """
    _check_output(output, overwrite)
    paths = _sources(sources)
    board = checkerboard.Checkerboard(*_corners(corners), square_mm / 1000.0)
    detections = [
        checkerboard.find_checkerboards(str(path), decode(path), count_frames(path), board, floor)
        for path in paths.values()
    ]
    lenses = [checkerboard.calibrate_lens(name, one, board) for name, one in zip(paths, detections, strict=True)]
    cameras, pair_errors = checkerboard.pose_cameras([lens.camera for lens in lenses], detections, board)
    if floor is None:
        cameras, up = checkerboard.place_level(cameras), f"camera {cameras[0].name} is assumed level"
    else:
        cameras = checkerboard.place_on_floor(cameras, detections, board, floor)
        up = f"the floor is the board of image {floor}"
    error_px = float(np.mean([lens.error_px for lens in lenses]))
    write_cameras(output, cameras, error_px, {"made_by": "workbench calibrate board", "up": up})
    for lens, one in zip(lenses, detections, strict=True):
        _print_lens(lens, one)
    for pair, errors in pair_errors.items():
        rms, names = np.sqrt(np.mean(np.square([*errors.values()]))), " with ".join(pair)
        print(f"{names}: {rms:.2f} px over {len(errors)} images with the board in both cameras")
        _print_by_image(names, errors)
    print(up)
    _print_written(output)


@app.command("height")
def _height(
    video: Annotated[Path, typer.Argument(metavar="VIDEO", help="A video or folder of images, for their size.")],
    annotations: Annotated[
        Path, typer.Argument(metavar="ANNOTATIONS", help="annotations.csv, or a folder of OpenPose's JSON.")
    ],
    height_m: Annotated[float, typer.Option(metavar="M", help="Height of the person.")],
    output: _Output,
    focal_px: Annotated[float | None, typer.Option(metavar="PX", help="Focal length, if known.")] = None,
    distance_m: Annotated[
        float | None, typer.Option(metavar="M", help="Distance from the camera to the person in the first frame.")
    ] = None,
    camera_height_m: Annotated[
        float | None, typer.Option(metavar="M", help="Height of the camera above the floor.")
    ] = None,
    name: Annotated[str, typer.Option(help="Name of the camera in the file.")] = "camera",
    overwrite: _Overwrite = False,
) -> None:
    """Calibrate a camera from a person of known height who stands upright at several places.

    Examples:
      workbench calibrate height walk.mp4 annotations.csv --height-m 1.65 \\
        -o camera.toml
      workbench calibrate height walk.mp4 annotations.csv --height-m 1.65 \\
        --focal-px 1400 -o camera.toml
    """
    _check_output(output, overwrite)
    check_name(name)
    measurements = person_height.Measurements(height_m, focal_px, distance_m, camera_height_m)
    image = next(decode(video), None)
    if image is None:
        raise InputError(f"{video}: expected images, found none that can be decoded")
    size, joints = (image.shape[1], image.shape[0]), read_annotations(annotations)
    segments = person_height.head_foot_segments(joints.frames, joints.pixels, joints.source)
    calibration = person_height.calibrate_by_height(name, size, segments, measurements)
    notes = {"made_by": "workbench calibrate height"} | {
        key: f"{calibration.values[key]:.4g} ± {deviation:.2g}" for key, deviation in calibration.sigma.items()
    }
    write_cameras(output, [calibration.camera], calibration.error_px, notes)
    _print_by_height(name, calibration)
    _print_written(output)


def _print_by_height(name: str, calibration: person_height.HeightCalibration) -> None:
    """Print the errors and the values of a camera that is calibrated by a person's height."""
    value, sigma = calibration.values, calibration.sigma
    n_frames, error_px = len(calibration.frames), calibration.error_px
    print(f"{name}: reprojection error of head and feet {error_px:.1f} px over {n_frames} frames")
    rms = np.sqrt([(errors**2).mean() * 2.0 for errors in calibration.errors_px])
    by_frame = (f"{frame}: {error:.1f}" for frame, error in zip(calibration.frames, rms, strict=True))
    print(f"px by frame: {', '.join(by_frame)}")
    print(
        f"focal length {value['focal_px']:.0f} ± {sigma['focal_px']:.0f} px, tilt {abs(value['tilt_deg']):.1f} ± "
        f"{sigma['tilt_deg']:.1f}° {'down' if value['tilt_deg'] >= 0.0 else 'up'}, roll {value['roll_deg']:.1f} ± "
        f"{sigma['roll_deg']:.1f}°, the camera {value['height_m']:.2f} ± {sigma['height_m']:.2f} m above the floor"
    )
    if calibration.focal_information < 0.5:
        print(
            "the annotations do not determine the focal length; a default is used. Annotate the person near to and far "
            "from a camera that points downwards, or add --focal-px, or --distance-m and --camera-height-m"
        )


def _check_output(output: Path, overwrite: bool) -> None:
    if output.suffix.lower() != ".toml":
        raise InputError(f"{output}: expected a file name with the suffix .toml")
    if output.exists() and not overwrite:
        raise InputError(f"{output}: the file exists; --overwrite replaces it")


def _print_written(output: Path) -> None:
    print(f"written to {output}; workbench check-calibration checks it")


def _print_lens(lens: checkerboard.Lens, detections: checkerboard.CheckerboardDetections) -> None:
    name, focal, (across, down) = lens.camera.name, lens.camera.matrix[0, 0], lens.coverage
    print(
        f"{name}: {lens.error_px:.2f} px over {len(lens.errors_px)} of {detections.n_searched} images; "
        f"focal length {focal:.1f} ± {lens.sigma_px:.1f} px; corners span {across:.0%} by {down:.0%} of the image"
    )
    _print_by_image(name, lens.errors_px)
    for number, error in lens.omitted_px.items():
        print(f"{name}: image {number} is omitted, reprojection error {error:.2f} px")
    if lens.sigma_px > _IMPRECISE * focal or min(lens.coverage) < 0.5:
        print(
            f"{name}: imprecise calibration; record more images with the board tilted, near, and at the image borders"
        )


def _print_by_image(name: str, errors_px: Mapping[int, float]) -> None:
    listed = ", ".join(f"{number}: {error:.2f}" for number, error in errors_px.items())
    print(f"{name}: px by image: {listed}")


def _sources(words: Sequence[str]) -> dict[str, Path]:
    sources: dict[str, Path] = {}
    for word in words:
        name, equals, path = word.partition("=")
        if not equals or not path:
            raise InputError(f"{word}: expected NAME=SOURCE, such as left=left.mp4")
        if check_name(name) in sources:
            raise InputError(f"{word}: camera {name} occurs twice")
        sources[name] = expanded(path)
    return sources


def _corners(text: str) -> tuple[int, int]:
    if (numbers := re.fullmatch("([0-9]+)x([0-9]+)", text)) is None:
        raise InputError(f"--corners: expected the numbers of inner corners, such as 9x6, found {text!r}")
    return int(numbers[1]), int(numbers[2])
