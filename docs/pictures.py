"""Draw the pictures of the pages, which show no images of real people.

`PYTHONPATH=. python docs/pictures.py FOLDER`, in a clone, draws the pictures of the tutorial from the recordings that
its commands write into FOLDER. With SHOT.png in place of FOLDER it makes the picture of the README from a screenshot of
the viewer with a recording of walk_multi_cue. With RUN.rrd it draws the picture of the page on own video, without
images, from a recording of `workbench track`. The pictures of experiments are drawn from the baselines when the pages
are built.
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
VIEWER = Path(__file__).parents[1] / "analysis" / "figures" / "walk_multi_cue.png"
_COLOURS, _GREYS = 160, 96
_COLOURFUL = 24  # grey levels between the strongest and the weakest channel of a pixel


def tutorial(folder: Path) -> None:
    """Draw the pictures of the tutorial; its Python code draws knee.png."""
    first, smooth = read(folder / "first"), read(folder / "smooth")
    with plt.style.context(STYLE):
        figure, row = plt.subplots(1, 3, figsize=(9, 4), layout="constrained")
        images(row, first, [10, 25, 40])
        figure.savefig(PICTURES / "first.png", dpi=90)
        figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
        colours = {"ar_offsets_gait": ESTIMATE, "smooth": TRUTH}
        over_frames(axes, {"ar_offsets_gait": first, "smooth": smooth}, "mpjpe_px", "error in the image (px)", colours)
        axes.plot(*first.metric("forearm_width_px"), color="gray", linestyle=":", label="width of a forearm")
        axes.legend()
        figure.savefig(PICTURES / "errors.png", dpi=90)
    (PICTURES / "knee.png").write_bytes((folder / "knee.png").read_bytes())


def own_video(run: Run) -> None:
    """Draw the estimated skeleton in five frames, and the flexion of both knees with its credible intervals."""
    with plt.style.context(STYLE):
        figure, axes = plt.subplots(1, 6, figsize=(9, 2.6), layout="constrained", width_ratios=(1, 1, 1, 1, 1, 3))
        frames = evenly(run, 7)[1:-1]
        skeletons(axes[:5], run, frames, azimuth_deg=30.0)
        for panel, frame in zip(axes, frames, strict=False):
            panel.set_title(f"frame {frame}")
        intervals = run.intervals
        for side, colour in (("left", ESTIMATE), ("right", TRUTH)):
            k = intervals.names.index(f"{side}_knee_flexion")
            low, mean, high = (np.degrees(each[:, k]) for each in (intervals.low, intervals.mean, intervals.high))
            axes[5].fill_between(intervals.frames, low, high, color=colour, alpha=0.25, linewidth=0.0)
            axes[5].plot(intervals.frames, mean, color=colour, label=f"{side} knee")
        axes[5].set_title("flexion of the knees (°)")
        axes[5].set_xlabel("frame")
        axes[5].legend()
        figure.savefig(PICTURES / "own_video.png", dpi=90)
        plt.close(figure)


def of_experiment(run: Run, path: Path) -> None:
    """Draw a recording of an experiment: the true and the posterior-mean skeleton in four frames and the joint error
    over frames, or the first figures of a study."""
    with plt.style.context(STYLE):
        if run.is_study:
            planar = [each for each in run.figures if not isinstance(each, Sticks)][:2]
            figure, row = plt.subplots(1, len(planar), figsize=(7.5, 2.6), layout="constrained", squeeze=False)
            for axes, each in zip(row[0], planar, strict=True):
                draw(axes, each)
                axes.set_title(each.name.rpartition("/")[2])
        else:
            figure, row = plt.subplots(1, 5, figsize=(7.5, 2.2), layout="constrained", width_ratios=(1, 1, 1, 1, 2.2))
            frames = evenly(run, 4)
            skeletons(row[: len(frames)], run, frames)
            for axes, frame in zip(row, frames, strict=False):
                axes.set_title(f"frame {frame}")
            metric = next(name for name in ("mpjpe_abs_mm", "jump_deg") if name in run.metrics)
            row[-1].plot(*run.metric(metric), color=ESTIMATE)
            row[-1].set_title(
                {"mpjpe_abs_mm": "error of the joints (mm)", "jump_deg": "rotation of the joints (°)"}[metric]
            )
            row[-1].set_xlabel("frame")
            row[-1].set_ylim(bottom=0.0)
        figure.savefig(path, dpi=80, metadata={"Software": None})
        plt.close(figure)


def shrink(shot: Path) -> None:
    """Reduce a screenshot of the viewer to 1200 × 760 px and 256 colours, most of them for the thin coloured lines."""
    image = Image.open(shot).convert("RGB").resize((1200, 760), Image.Resampling.LANCZOS)
    pixels = np.asarray(image)
    colourful = pixels[np.ptp(pixels.astype(int), axis=2) > _COLOURFUL]
    strip = Image.fromarray(colourful[None]).quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    greys = np.repeat(np.linspace(0, 255, _GREYS).round().astype(int), 3).tolist()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*(strip.getpalette() or [])[: 3 * _COLOURS], *greys])
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(VIEWER, optimize=True)


if __name__ == "__main__":
    source = Path(sys.argv[1])
    if source.suffix == ".rrd":
        own_video(read(source))
    else:
        tutorial(source) if source.is_dir() else shrink(source)
