"""Paper A, fig. 1: samples in the image, the body, and the points at which the likelihood compares images.

From walk_straight. The paper draws samples and body; the points, of its section 5, are our addition.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from analysis.figures.readings import OURS, PaperFigure, Reading
from analysis.figures.run_descriptions import setup
from analysis.figures.style import ON_IMAGE, bare, canvas
from tests.oracles.image_motion import PosedView, hidden_samples, inside_image, limb_patches
from workbench.body.kinematics import forward
from workbench.body.limbs import Body, person
from workbench.body.shape import read_shape
from workbench.body.skeleton import POSE_NAMES
from workbench.cameras.camera import Camera, plain_camera
from workbench.likelihoods.image_motion import ImageMotion
from workbench.recording.read.chunks import read_chunks, static_values
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import FAINT, INK, SERIES
from workbench.results.pictures import Picture, pictures
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

PLACES = ("n_samples", "seed", "sampling", "taper", "occlusion")
"""What of a recorded likelihood decides where its points are and which count."""
STANDING = {
    "root_z": 0.95, "left_shoulder_abduction": 0.5, "right_shoulder_abduction": 0.5, "left_hip_abduction": 0.15,
    "right_hip_abduction": 0.15,
}  # fmt: skip
FRONT = plain_camera(480, 640, 1300.0, (4.6, -1.6, 1.3), (0.0, 0.0, 0.88))
AXES_M, AXES = 0.16, dict(zip("XYZ", (SERIES[1], SERIES[2], SERIES[0]), strict=True))
MARGIN_PX, FEW = 28.0, 10
SEEN, UNSEEN = "#FFE9B0", "#4A2C00"


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw particles over an image; the limbs with their axes; patches and points as we place them, and as A does."""
    run = readings["walk_straight"].ours
    body = person(read_shape(str(run.path), run.properties["shape"]))
    row = len(run.poses[0]) // 2
    (shot,) = pictures(run, [int(run.poses[0][row])])
    recorded: Mapping[str, Any] = run.settings.get("likelihood") or {}
    ours = ImageMotion(body, **{key: recorded[key] for key in PLACES if key in recorded})
    cues = (ours, replace(ours, sampling="random", taper=False, occlusion="limb"))
    placements = [_placed(shot, _camera(run), cue, run.poses[1][row]) for cue in cues]
    counted = [f"{int(counts.sum())} of {counts.size}" for _, _, counts in placements]
    figure = canvas("Paper A, fig. 1: samples, body, and the points compared", 4.3, _caption(run, shot, ours, counted))
    samples, model, *compared = figure.subplots(1, 4)
    _image(samples, shot)
    some = shot.skeletons["particles"][: FEW * len(shot.skeletons["estimate"])]  # each is as many lines
    samples.add_collection(LineCollection(list(some), colors=ON_IMAGE["particles"], linewidths=0.4))
    _limbs(model, body)
    for axes, placed in zip(compared, placements, strict=True):
        _image(axes, shot)
        _points(axes, *placed)
    titles = ("(a) samples", "(b) body and axes", "points, ours", "points, as A has them")
    for axes, title in zip((samples, model, *compared), titles, strict=True):
        axes.set_title(title)
    return figure


def _caption(run: Run, shot: Picture, cue: ImageMotion, counted: Sequence[str]) -> str:
    return (
        f"{setup(run)}; frame {shot.frame}. (a) {FEW} particles, as often as they weigh. (b) Truncated cones and "
        "spheres, each with its own axes, Z along it. Right: at the expected pose, every limb's planar patch and "
        f"{cue.n_samples} points of it; light: compared, dark: outside the image or hidden. Ours ({counted[0]} "
        "compared) are spread evenly but for the rim, limbs taper, and a point is hidden where another limb covers it. "
        f"A's ({counted[1]}) are drawn from the whole patch of a cylinder, and of a limb that a nearer one covers in "
        "part none counts. The paper: (a) a few samples over a photograph; (b) 9 cylinders for our cones, and 3 "
        "spheres; the points in words alone. Not A's in either: a rendered person, samples as skeletons; all limbs and "
        "particles share the points of one patch; a sphere's patch is the square inside its outline."
    )


def _image(axes: Axes, shot: Picture) -> None:
    """Draw the image, cut to the expected pose."""
    axes.imshow(shot.image, cmap="gray", vmin=0, vmax=255)
    places = shot.skeletons["estimate"].reshape(-1, 2)
    low, high = places.min(axis=0) - MARGIN_PX, places.max(axis=0) + MARGIN_PX
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])
    axes.set_axis_off()


def _placed(
    shot: Picture, camera: Camera, cue: ImageMotion, pose: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return patches' outlines (L, 4, 2) and points (L, n, 2), px, at a pose (P,), and which points are compared (L,
    n)."""
    limbs, grey = cue.compared_body.limbs, np.zeros(shot.image.shape[:2], dtype=np.float32)
    patches = limb_patches(limbs, PosedView(camera, grey, forward(cue.body.skeleton, pose[None])))
    places = patches.positions(cue.samples)
    counts = inside_image(grey, places) & ~hidden_samples(limbs, patches, cue.samples, cue.occlusion)
    counts &= (patches.cos_alpha > 0.0)[..., None]
    return patches.corners[0].reshape(len(limbs), 4, 2)[:, [0, 1, 3, 2]], places[0], counts[0]


def _points(axes: Axes, outlines: FloatArray, places: FloatArray, counts: BoolArray) -> None:
    """Draw patches, and their points by whether they are compared."""
    edges = {"facecolors": "none", "edgecolors": ON_IMAGE["estimate"], "linewidths": 0.8}
    axes.add_collection(PolyCollection(list(outlines), **edges))
    for some, colour, size in ((~counts, UNSEEN, 1.2), (counts, SEEN, 1.6)):
        axes.scatter(*places[some].T, s=size, color=colour, linewidths=0.0, zorder=3)


def _limbs(axes: Axes, body: Body) -> None:
    """Draw the limbs of a standing person, as the outlines of cones and spheres, and the axes of each."""
    pose = np.zeros(len(POSE_NAMES))
    for name, value in STANDING.items():
        pose[POSE_NAMES.index(name)] = value
    frames, limbs = forward(body.skeleton, pose[None]), body.limbs
    turns, origins = frames.rotations[0, limbs.joints], frames.positions[0, limbs.joints]
    local_axes = turns @ limbs.axes
    for k in range(len(limbs)):
        ends = [origins[k] + turns[k] @ end for end in (limbs.starts[k], limbs.ends[k])]
        lines = [FRONT.project(line) for line in _outline(ends, local_axes[k], limbs.radii[k], bool(limbs.spheres[k]))]
        axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.5))
        for along, colour in zip(local_axes[k].T, AXES.values(), strict=True):
            axes.plot(*FRONT.project(np.stack([ends[0], ends[0] + AXES_M * along])).T, color=colour, linewidth=1.0)
    for j, (name, colour) in enumerate(AXES.items()):
        axes.text(0.04 + 0.1 * j, 0.02, name, color=colour, transform=axes.transAxes, fontweight="bold")
    axes.axhline(float(FRONT.project(np.zeros(3))[1]), color=FAINT, linewidth=0.5, zorder=0)
    axes.autoscale_view()
    axes.invert_yaxis()
    bare(axes)


def _outline(ends: Sequence[FloatArray], local_axes: FloatArray, radii: FloatArray, sphere: bool) -> list[FloatArray]:
    """Return lines (n, 3), m, on a limb: three circles on a sphere, else the sections at both ends and four lines
    between."""
    x, y, z = local_axes.T
    turn = np.linspace(0.0, 2.0 * np.pi, 49)[:, None]
    sections = [(end, x, y, radii[j]) for j, end in enumerate(ends)]
    if sphere:
        sections = [(ends[0], *pair, radii[0]) for pair in ((x, y), (y, z), (x, z))]
    rings = [end + np.cos(turn) * size[0] * a + np.sin(turn) * size[1] * b for end, a, b, size in sections]
    sides = [] if sphere else [np.stack(pair) for pair in zip(rings[0][:-1:12], rings[1][:-1:12], strict=True)]
    return [*rings, *sides]


def _camera(run: Run) -> Camera:
    """Return the first camera as it was recorded, of straightened images; raises InputError where there is none."""
    values_by_path = static_values(read_chunks(run.path, ["/world/**"]))
    paths = sorted(path for path, values in values_by_path.items() if "Pinhole:image_from_camera" in values)
    if not paths:
        raise InputError(f"{run.path}: expected a camera, found none")
    lens, place = values_by_path[paths[0]], values_by_path[paths[0].removesuffix("/image")]

    def numbers(values: Mapping[str, Any], key: str) -> FloatArray:
        return np.array(values[key].as_py()[0], dtype=np.float64)

    matrix = numbers(lens, "Pinhole:image_from_camera").reshape(3, 3).T  # recorded column after column
    rotation = numbers(place, "Transform3D:mat3x3").reshape(3, 3)  # of the inverse, column after column
    width, height = (int(size) for size in numbers(lens, "Pinhole:resolution"))
    translation = -rotation @ numbers(place, "Transform3D:translation")
    return Camera(paths[0], width, height, matrix, rotation, translation, np.zeros(5))


FIGURES = {"a_fig1_body": PaperFigure(("walk_straight",), OURS, draw)}
