"""workbench-calibrate: calibrate cameras by images of a checkerboard, or of a person of known height.

  workbench-calibrate board left=left.mp4 right=right.mp4 --corners 9x6 --square-mm 25 --floor 120 -o cameras.toml
  workbench-calibrate height walk.mp4 marks.csv --height-m 1.65 -o camera.toml

The file is an input of dataset.camera; .docs/formats.md describes it. workbench-look-at checks whether it fits.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from workbench.camera_calibration import checkerboard, person_height
from workbench.camera_calibration.camera_file import check_name, write_cameras
from workbench.datasets.files.decode import decode
from workbench.datasets.files.joint_annotations import read_marks
from workbench.utils.errors import InputError

LOOSE = 0.02
"""Relative standard deviation of a focal length above which more images are requested."""


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate. Return 0, or 2 after an error, which is printed; then nothing is written."""
    arguments = _parser().parse_args(argv)
    try:
        if arguments.output.suffix.lower() != ".toml":
            raise InputError(f"{arguments.output}: expected a name that ends in .toml")
        if arguments.output.exists() and not arguments.overwrite:
            raise InputError(f"{arguments.output}: exists; --overwrite replaces it")
        sentences = arguments.run(arguments)
    except InputError as error:
        print(f"workbench-calibrate: {error}", file=sys.stderr)
        return 2
    print("\n".join(sentences))
    print(f"written to {arguments.output}; workbench-look-at checks whether it fits")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="workbench-calibrate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ways = parser.add_subparsers(metavar="board|height", required=True)
    board = ways.add_parser("board", help="by a checkerboard, for one camera or several")
    board.add_argument(
        "sources", metavar="NAME=SOURCE", nargs="+", help="a video or folder of images by the camera's name"
    )
    board.add_argument("--corners", metavar="9x6", required=True, help="inner corners, one less than squares each way")
    board.add_argument("--square-mm", metavar="MM", type=float, required=True, help="side of a square, mm")
    board.add_argument(
        "--floor", metavar="IMAGE", type=int, help="number, from 0, of an image in which the board lies on the floor; "
        "without it the first camera is assumed level"
    )  # fmt: skip
    height = ways.add_parser("height", help="by a person of known height, upright at several places")
    height.add_argument("video", metavar="VIDEO", type=Path, help="a video or folder of images, for their size")
    height.add_argument("marks", metavar="MARKS", type=Path, help="marks.csv, or a folder of OpenPose's JSON")
    height.add_argument("--height-m", metavar="M", type=float, required=True, help="of the person")
    height.add_argument("--focal-px", metavar="PX", type=float, help="focal length, where it is known")
    height.add_argument(
        "--distance-m", metavar="M", type=float, help="from the camera to the person in the first frame"
    )
    height.add_argument("--camera-height-m", metavar="M", type=float, help="of the camera above the floor")
    height.add_argument("--name", default="camera", help="of the camera in the file")
    for way, run in ((board, _board), (height, _height)):
        way.add_argument("-o", "--output", metavar="FILE.toml", type=Path, required=True, help="the file to write")
        way.add_argument("--overwrite", action="store_true", help="replace an existing file")
        way.set_defaults(run=run)
    return parser


def _board(arguments: argparse.Namespace) -> list[str]:
    """Calibrate by a board, write the file, and return sentences on the result."""
    sources = _sources(arguments.sources)
    board = checkerboard.Checkerboard(*_corners(arguments.corners), arguments.square_mm / 1000.0)
    detections = [checkerboard.find_boards(path, board, arguments.floor) for path in sources.values()]
    lenses = [checkerboard.calibrate_lens(name, one, board) for name, one in zip(sources, detections, strict=True)]
    cameras, pair_errors = checkerboard.pose_cameras([lens.camera for lens in lenses], detections, board)
    if arguments.floor is None:
        cameras, up = checkerboard.place_level(cameras), f"up is that of camera {cameras[0].name}, assumed level"
    else:
        cameras = checkerboard.place_on_floor(cameras, detections, board, arguments.floor)
        up = f"the floor is image {arguments.floor}'s board"
    error_px = float(np.mean([lens.error_px for lens in lenses]))
    write_cameras(arguments.output, cameras, error_px, {"made_by": "workbench-calibrate board", "up": up})
    sentences = [text for lens, one in zip(lenses, detections, strict=True) for text in _lens_sentences(lens, one)]
    return [*sentences, *(text for pair in pair_errors.items() for text in _pair_sentences(*pair)), up]


def _lens_sentences(lens: checkerboard.Lens, detections: checkerboard.BoardDetections) -> list[str]:
    camera, focal = lens.camera, lens.camera.matrix[0, 0]
    across, down = lens.coverage
    sentences = [
        f"{camera.name}: {lens.error_px:.2f} px over {len(lens.errors_px)} images of {detections.n_searched} searched; "
        f"focal length {focal:.1f} ± {lens.sigma_px:.1f} px; corners span {across:.0%} by {down:.0%} of the image",
        _by_image(camera.name, lens.errors_px),
    ]
    sentences += [f"{camera.name}: image {n} is omitted, {error:.2f} px" for n, error in lens.omitted_px.items()]
    if lens.sigma_px > LOOSE * focal or min(lens.coverage) < 0.5:
        sentences.append(
            f"{camera.name}: imprecise: show the board tilted, near, and up to the image's edges, in more images"
        )
    return sentences


def _pair_sentences(pair: tuple[str, str], errors_px: Mapping[int, float]) -> list[str]:
    errors, names = np.array(list(errors_px.values())), " with ".join(pair)
    text = f"{names}: {np.sqrt((errors**2).mean()):.2f} px over {len(errors)} images in which both show the board"
    return [text, _by_image(names, errors_px)]


def _by_image(name: str, errors_px: Mapping[int, float]) -> str:
    """Write the residual of every image in one line."""
    listed = ", ".join(f"{number}: {error:.2f}" for number, error in errors_px.items())
    return f"{name}: px by image: {listed}"


def _height(arguments: argparse.Namespace) -> list[str]:
    """Calibrate by a person's height, write the file, and return sentences on the result."""
    name = check_name(arguments.name)
    known = person_height.Measurements(
        arguments.height_m, arguments.focal_px, arguments.distance_m, arguments.camera_height_m
    )
    image = next(decode(arguments.video), None)
    if image is None:
        raise InputError(f"{arguments.video}: expected images, found none that can be decoded")
    marks = read_marks(arguments.marks)
    size, segments = (image.shape[1], image.shape[0]), person_height.head_foot_segments(marks)
    calibration = person_height.calibrate_by_height(name, size, *segments, known)
    notes = {"made_by": "workbench-calibrate height"} | {
        key: f"{calibration.values[key]:.4g} ± {sigma:.2g}" for key, sigma in calibration.sigma.items()
    }
    write_cameras(arguments.output, [calibration.camera], calibration.error_px, notes)
    return _height_sentences(calibration)


def _height_sentences(calibration: person_height.HeightCalibration) -> list[str]:
    value, sigma = calibration.values, calibration.sigma
    sentences = [
        f"{calibration.camera.name}: heads and feet of {len(calibration.frames)} frames are "
        f"{calibration.error_px:.1f} px off",
        "px by frame: " + ", ".join(
            f"{frame}: {np.sqrt((errors**2).mean() * 2.0):.1f}"
            for frame, errors in zip(calibration.frames, calibration.errors_px, strict=True)
        ),
        f"focal length {value['focal_px']:.0f} ± {sigma['focal_px']:.0f} px, tilt {abs(value['tilt_deg']):.1f} ± "
        f"{sigma['tilt_deg']:.1f}° {'down' if value['tilt_deg'] >= 0.0 else 'up'}, roll {value['roll_deg']:.1f} ± "
        f"{sigma['roll_deg']:.1f}°, the camera {value['height_m']:.2f} ± {sigma['height_m']:.2f} m above the floor",
    ]  # fmt: skip
    if calibration.focal_information < 0.5:
        sentences.append(
            "the annotations do not determine the focal length, which is the usual one: a camera that looks down on "
            "people near and far does; or give --focal-px, or --distance-m and --camera-height-m"
        )
    return sentences


def _sources(words: Sequence[str]) -> dict[str, Path]:
    sources: dict[str, Path] = {}
    for word in words:
        name, equals, path = word.partition("=")
        if not equals or not path:
            raise InputError(f"{word}: expected NAME=SOURCE, such as left=left.mp4")
        if check_name(name) in sources:
            raise InputError(f"{word}: camera {name} is named twice")
        sources[name] = Path(path).expanduser()
    return sources


def _corners(text: str) -> tuple[int, int]:
    columns, by, rows = text.partition("x")
    if not (by and columns.isascii() and rows.isascii() and columns.isdigit() and rows.isdigit()):
        raise InputError(f"--corners: expected two numbers of inner corners, such as 9x6, found {text!r}")
    return int(columns), int(rows)
