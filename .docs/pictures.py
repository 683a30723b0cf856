"""The documents' pictures, of rendered people only.

`PYTHONPATH=. python .docs/pictures.py FOLDER`, in a clone, draws the tutorial's, of what its commands left in FOLDER;
with SHOT.png in place of FOLDER it makes the README's of a shot of the viewer that shows a recording of walk_best.
Those of experiments are drawn, of the baselines, when the pages are built.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from analysis.figures.panels import evenly, images, over_frames, skeletons
from workbench.core.study import Sticks
from workbench.recording.read.reader import Run, read
from workbench.recording.study.drawing import ESTIMATE, STYLE, TRUTH, draw

PICTURES = Path(__file__).parent / "pictures"
VIEWER = Path(__file__).parents[1] / "analysis" / "figures" / "walk_best.png"
_COLOURS, _GREYS = 160, 96
_COLOURFUL = 24  # levels between a pixel's strongest and weakest channel


def tutorial(folder: Path) -> None:
    """Draw the tutorial's; knee.png is what its own Python drew."""
    first, smooth = read(folder / "first"), read(folder / "smooth")
    with plt.style.context(STYLE):
        figure, row = plt.subplots(1, 3, figsize=(9, 4), layout="constrained")
        images(row, first, [10, 25, 40])
        figure.savefig(PICTURES / "first.png", dpi=90)
        figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
        colours = {"walking": ESTIMATE, "smooth": TRUTH}
        over_frames(axes, {"walking": first, "smooth": smooth}, "error_px", "error in the image (pixels)", colours)
        axes.plot(*first.metric("forearm_px"), color="gray", linestyle=":", label="a forearm's width")
        axes.legend()
        figure.savefig(PICTURES / "errors.png", dpi=90)
    (PICTURES / "knee.png").write_bytes((folder / "knee.png").read_bytes())


def of_experiment(run: Run, path: Path) -> None:
    """Draw what a recording of an experiment shows: the true and the expected skeleton in four frames and the error of
    the joints over frames, or the first figures of a study."""
    with plt.style.context(STYLE):
        if run.is_study:
            flat = [figure for figure in run.figures if not isinstance(figure, Sticks)][:2]
            figure, row = plt.subplots(1, len(flat), figsize=(7.5, 2.6), layout="constrained", squeeze=False)
            for axes, drawn in zip(row[0], flat, strict=True):
                draw(axes, drawn)
                axes.set_title(drawn.name.rpartition("/")[2])
        else:
            figure, row = plt.subplots(1, 5, figsize=(7.5, 2.2), layout="constrained", width_ratios=(1, 1, 1, 1, 2.2))
            frames = evenly(run, 4)
            skeletons(row[: len(frames)], run, frames)
            for axes, frame in zip(row, frames, strict=False):
                axes.set_title(f"frame {frame}")
            metric = next(name for name in ("error_abs_mm", "jump_deg") if name in run.metrics)
            row[-1].plot(*run.metric(metric), color=ESTIMATE)
            row[-1].set_title(
                {"error_abs_mm": "error of the joints (mm)", "jump_deg": "turn of the joints (°)"}[metric]
            )
            row[-1].set_xlabel("frame")
            row[-1].set_ylim(bottom=0.0)
        figure.savefig(path, dpi=80, metadata={"Software": None})
        plt.close(figure)


def shrink(shot: Path) -> None:
    """Make a shot of the viewer small: 1200 × 760 px in 256 colours, of which the thin coloured lines have most."""
    image = Image.open(shot).convert("RGB").resize((1200, 760), Image.Resampling.LANCZOS)
    pixels = np.asarray(image)
    colourful = pixels[np.ptp(pixels.astype(int), axis=2) > _COLOURFUL]
    strip = Image.fromarray(colourful[None]).quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    greys = np.repeat(np.linspace(0, 255, _GREYS).round().astype(int), 3).tolist()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*(strip.getpalette() or [])[: 3 * _COLOURS], *greys])
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(VIEWER, optimize=True)


if __name__ == "__main__":
    place = Path(sys.argv[1])
    tutorial(place) if place.is_dir() else shrink(place)
