"""Drawings of runs that track: images with skeletons, bodies in space, marginals, errors, flexions."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from analysis.figures.frames import Scene, scenes
from analysis.figures.studies import projected
from analysis.figures.style import ON_IMAGE, POINTS, bare
from workbench.recording.read.chunks import Curve
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import ESTIMATE, FAINT, SERIES, TRUTH, label_ends
from workbench.results.pictures import Picture, pictures
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_MARGIN_PX, _MOVES_PX = 18.0, 3.0
_IMAGE_SHAPE = 0.7  # width of an image over its height
_WIDTHS = {"particles": 0.25, "estimate": 1.6, "truth": 0.8}
_SKIN = np.array([0.84, 0.66, 0.5])
_BODY_SIZE_M = (1.2, 1.9)  # width and height that a body's panel shows


def evenly(run: Run, n: int) -> list[int]:
    """Return n of the run's frames, equally spaced from the first to the last."""
    frames = run.poses[0]
    return [int(frame) for frame in frames[np.unique(np.linspace(0, len(frames) - 1, n).round().astype(int))]]


def images(row: Sequence[Axes], run: Run, frames: Sequence[int]) -> None:
    """Draw images, one of the axes each, cut to what moves, with the posterior's skeletons, expected pose and truth."""
    recorded_pictures = list(pictures(run, frames))
    boxes = _boxes(recorded_pictures)
    half = 0.5 * np.max(boxes[:, 1] - boxes[:, 0], axis=0) + _MARGIN_PX
    half = np.maximum(half, half[::-1] * (_IMAGE_SHAPE, 1.0 / _IMAGE_SHAPE))
    for axes, shot, middle in zip(row, recorded_pictures, boxes.mean(axis=1), strict=True):
        height, width = shot.image.shape[:2]
        axes.imshow(shot.image, cmap="gray", vmin=0, vmax=255)
        for name in ("particles", "estimate", "truth"):
            lines = LineCollection(list(shot.skeletons[name]), colors=ON_IMAGE[name], linewidths=_WIDTHS[name])
            lines.set_alpha(0.5 if name == "particles" else 1.0)
            axes.add_collection(lines)
        middle = np.clip(middle, half - 0.5, np.maximum([width, height] - half - 0.5, half - 0.5))  # inside the image
        axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
        axes.set_ylim(middle[1] + half[1], middle[1] - half[1])
        axes.set_axis_off()
        axes.set_title(f"frame {shot.frame}", fontsize=7.5, pad=2.0)


def _boxes(recorded: Sequence[Picture]) -> FloatArray:
    """Return corners (F, 2, 2), pixels, about those lines in every picture that move, of the truth where it is
    known."""
    name = "truth" if all(len(shot.skeletons["truth"]) for shot in recorded) else "estimate"
    lines = np.stack([shot.skeletons[name] for shot in recorded])
    moving = np.ptp(lines, axis=0).max(axis=(1, 2)) > _MOVES_PX
    places = lines[:, moving if moving.any() else slice(None)].reshape(len(recorded), -1, 2)
    return np.stack([places.min(axis=1), places.max(axis=1)], axis=1)


def skeletons(row: Sequence[Axes], run: Run, frames: Sequence[int], azimuth_deg: float = -60.0) -> None:
    """Draw the expected pose and the truth in space, where the truth is, seen from that azimuth and a little above."""
    for axes, scene in zip(row, scenes(run, frames), strict=True):
        for lines, colour, width in ((scene.truth, TRUTH, 1.2), (scene.estimate, ESTIMATE, 1.8)):
            flat = list(projected(lines, azimuth_deg, 15.0))
            axes.add_collection(LineCollection(flat, colors=colour, linewidths=width))
        _frame_body(axes, projected(_body(scene).reshape(-1, 3), azimuth_deg, 15.0))


def bodies(row: Sequence[Axes], run: Run, frames: Sequence[int]) -> None:
    """Draw the fitted surface and the observed points, from the observing direction; without a surface the skeleton."""
    shown = scenes(run, frames)
    azimuth = _azimuth_deg(shown)
    for axes, scene in zip(row, shown, strict=True):
        _surface(axes, scene.vertices, scene.triangles, azimuth)
        if not len(scene.vertices):
            lines = list(projected(scene.estimate, azimuth, 0.0))
            axes.add_collection(LineCollection(lines, colors=ESTIMATE, linewidths=2.0))
        points = projected(scene.points, azimuth, 0.0)
        axes.scatter(points[:, 0], points[:, 1], s=0.7, color=POINTS, linewidths=0.0, zorder=3)
        truth = list(projected(scene.truth, azimuth, 0.0))
        axes.add_collection(LineCollection(truth, colors=TRUTH, linewidths=0.8, zorder=4))
        _frame_body(axes, projected(_body(scene).reshape(-1, 3), azimuth, 0.0))
        axes.set_title(f"frame {scene.frame}", fontsize=7.5, pad=2.0)


def points(row: Sequence[Axes], run: Run, frames: Sequence[int], azimuth_offset_deg: float) -> None:
    """Draw the observed points and the true skeleton, at an azimuth relative to the observing direction."""
    recorded_scenes = scenes(run, frames)
    azimuth = _azimuth_deg(recorded_scenes) + azimuth_offset_deg
    for axes, scene in zip(row, recorded_scenes, strict=True):
        flat = projected(scene.points, azimuth, 0.0)
        axes.scatter(flat[:, 0], flat[:, 1], s=0.7, color=POINTS, linewidths=0.0)
        truth = list(projected(scene.truth, azimuth, 0.0))
        axes.add_collection(LineCollection(truth, colors=TRUTH, linewidths=0.8))
        _frame_body(axes, projected(_body(scene).reshape(-1, 3), azimuth, 0.0))
        axes.set_title(f"frame {scene.frame}", fontsize=7.5, pad=2.0)


def around(row: Sequence[Axes], run: Run, frame: int) -> None:
    """Draw the fitted surface and skeleton of one frame, seen from as many sides as there are axes, evenly round."""
    (scene,) = scenes(run, [frame])
    for axes, azimuth in zip(row, np.linspace(0.0, 360.0, len(row), endpoint=False), strict=True):
        _surface(axes, scene.vertices, scene.triangles, float(azimuth))
        lines = list(projected(scene.estimate, float(azimuth), 0.0))
        axes.add_collection(LineCollection(lines, colors=ESTIMATE, linewidths=1.0))
        _frame_body(axes, projected(scene.estimate.reshape(-1, 3), float(azimuth), 0.0))
        axes.set_title(f"{azimuth:.0f}°", fontsize=7.5, pad=2.0)


def marginal(axes: Axes, run: Run, name: str, title: str) -> None:
    """Draw the log posterior of a parameter over frames as brightness, in degrees where it is an angle, and the
    truth."""
    marginals = run.marginals
    if marginals is None or name not in marginals.names:
        raise InputError(f"{run.path}: no marginal of {name!r}")
    k = marginals.names.index(name)
    factor = 180.0 / np.pi if marginals.units[k] == "rad" else 1.0
    first, last = float(marginals.frames[0]), float(marginals.frames[-1])
    extent = (first - 0.5, last + 0.5, factor * marginals.low[k], factor * marginals.high[k])
    axes.imshow(
        marginals.log_mass[k], cmap="gray", origin="lower", aspect="auto", extent=extent, interpolation="nearest"
    )
    truth = run.scalars.get(f"posterior/parameters/{name}/truth")
    if truth is not None:
        axes.plot(truth.frames, factor * truth.values[:, 0], color=ON_IMAGE["truth"], linewidth=1.1)
    axes.set_title(title)
    axes.set_xlabel("frame")
    axes.set_xlim(first - 0.5, last + 0.5)


def over_frames(axes: Axes, runs: Mapping[str, Run], metric: str, y_name: str, colours: Mapping[str, str]) -> None:
    """Draw a metric of several runs over frames, each with its label at its end."""
    ends = []
    for label, run in runs.items():
        frames, values = run.metric(metric)
        axes.plot(frames, values, color=colours[label])
        ends.append((label, colours[label], float(frames[-1]), float(values[-1])))
    axes.set_xlabel("frame")
    axes.set_ylabel(y_name)
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.0)
    label_ends(axes, ends, gap=0.18)


def flexion(axes: Axes, rows: Mapping[str, Curve], title: str) -> None:
    """Draw a joint's flexion as fitted and as it was, degrees over frames (paper D, fig. 6)."""
    for name, colour, width in (("truth", TRUTH, 2.2), ("estimate", ESTIMATE, 1.1)):
        if name in rows:
            axes.plot(rows[name].frames, rows[name].values[:, 0], color=colour, linewidth=width)
    axes.set_title(title)
    axes.set_xlabel("frame")
    axes.set_ylabel("flexion (degrees)")
    axes.margins(x=0.0)


def activity_lanes(axes: Axes, run: Run, activities: Mapping[str, Mapping[int, str]]) -> None:
    """Draw the activity in every frame, one lane for the estimate and one for the truth."""
    names = sorted({activity for row in activities.values() for activity in row.values()}, reverse=True)
    for y, lane in enumerate(("estimate", "truth")):
        for frame, activity in activities.get(lane, {}).items():
            axes.barh(y, 1.0, left=frame - 0.5, height=0.7, color=SERIES[names.index(activity) % len(SERIES)])
    for k, name in enumerate(names):
        axes.text(1.01, 0.75 - 0.5 * k, name, color=SERIES[k % len(SERIES)], transform=axes.transAxes, va="center")
    axes.set_yticks([0, 1], ["estimate", "truth"])
    axes.set_xlim(run.poses[0][0] - 0.5, run.poses[0][-1] + 0.5)
    axes.invert_yaxis()
    axes.set_xlabel("frame")


def _surface(axes: Axes, vertices: FloatArray, triangles: IntArray, azimuth_deg: float) -> None:
    """Draw triangles that face the viewer, the farthest first, the brighter the more they do."""
    if not len(triangles):
        return
    azimuth = np.radians(azimuth_deg)
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals @ towards / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    order = np.argsort(corners.mean(axis=1) @ towards)
    order = order[facing[order] > 0.0]
    shades = (0.45 + 0.55 * facing[order])[:, None] * _SKIN
    flat = projected(corners[order], azimuth_deg, 0.0)
    skin = PolyCollection(list(flat), facecolors=shades, edgecolors=shades, linewidths=0.3, rasterized=True)
    axes.add_collection(skin)


def _body(scene: Scene) -> FloatArray:
    """Return the skeleton's lines, of the truth if available, because an estimate may be lost."""
    return scene.truth if len(scene.truth) else scene.estimate


def _azimuth_deg(recorded_scenes: Sequence[Scene]) -> float:
    """Return the azimuth of the observing direction, by the side of the body on which the points are."""
    offsets = [
        np.median(scene.points[:, :2], axis=0) - _body(scene).reshape(-1, 3)[:, :2].mean(axis=0)
        for scene in recorded_scenes
        if len(scene.points)
    ]
    x, y = np.mean(offsets, axis=0) if offsets else (0.0, -1.0)
    return float(np.degrees(np.arctan2(y, x)))


def _frame_body(axes: Axes, flat: FloatArray) -> None:
    """Show a window of one size about a body, with the ground."""
    middle, (width, height) = 0.5 * (flat.min(axis=0) + flat.max(axis=0)), _BODY_SIZE_M
    axes.axhline(float(flat[:, 1].min()), color=FAINT, linewidth=0.6, zorder=0)
    axes.set_xlim(middle[0] - 0.5 * width, middle[0] + 0.5 * width)
    axes.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)
    bare(axes)
