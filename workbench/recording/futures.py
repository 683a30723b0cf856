"""A run and what might have become of it in one recording: skeletons over its images and in its world, and errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.recording.read.chunks import read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.write import images, scene
from workbench.recording.write.columns import Columns, curves
from workbench.recording.write.file import new_stream
from workbench.recording.write.layout import page
from workbench.utils.arrays import FloatArray, IntArray

FUTURES = "futures"
_HELD, _LOST = (90, 210, 120), (230, 90, 80)


@dataclass(frozen=True, eq=False)
class Shown:
    """One future as it is shown. name: what was changed, and the seed. frames: (F,). times_s: (F,). errors: (F,),
    widths of a forearm. places: (F, J, 3), m, of the joints, as cameras see them. held: whether it held the person."""

    name: str
    frames: IntArray
    times_s: FloatArray
    errors: FloatArray
    places: FloatArray
    cameras: tuple[Camera, ...]
    held: bool


def write_futures(path: Path, run: Run, body: Body, futures: Sequence[Shown], text: str) -> None:
    """Write the run's images, truth and estimate with all futures over them, and what came of it, in Markdown."""
    stream = new_stream("workbench-why", f"{run.id}-why")
    stream.set_sinks(rr.FileSink(path), default_blueprint=_layout(run))
    stream.send_chunks(read_chunks(run.path, ["/world/**", "/metrics/**"]))
    stream.log("why", rr.TextDocument(text, media_type="text/markdown"), static=True)
    columns, chains = Columns(), scene.figure(body).chains
    for k, future in enumerate(futures):
        series = rr.SeriesLines(colors=[_colour(future)], names=[future.name], widths=[1.0])
        stream.log(f"{FUTURES}/{k}/error", series, static=True)
        _add(columns, f"{FUTURES}/{k}", future, chains)
    columns.write(stream)
    stream.flush()
    stream.disconnect()


def _colour(future: Shown) -> tuple[int, int, int]:
    return _HELD if future.held else _LOST


def _add(columns: Columns, name: str, future: Shown, chains: IntArray) -> None:
    """Add a future's errors, and its skeletons over the images, of which none is left after its last frame."""
    pictures, shade = [images.picture(camera) for camera in future.cameras], np.array([_colour(future)], dtype=np.uint8)
    times = [np.timedelta64(round(time_s * 1e9), "ns") for time_s in future.times_s]
    for frame, time, error, place in zip(future.frames.tolist(), times, future.errors, future.places, strict=True):
        columns.add(frame, time, curves({f"{name}/error": float(error)}))
        for picture in pictures:
            columns.add(frame, time, images.overlay(picture, name, place[None], chains, shade))
    for picture in pictures:
        after = int(future.frames[-1]) + 1, times[-1] + (times[-1] - times[0]) // max(1, len(times) - 1)
        columns.add(*after, images.overlay(picture, name, future.places[:0], chains, shade[:0]))


def _layout(run: Run) -> rrb.Blueprint:
    """Lay out the image on the left, errors and what came of it on the right."""
    paths = {chunk.entity_path for chunk in read_chunks(run.path, ["/world/**"])}
    cameras = sorted(path.removesuffix("/image") for path in paths if path.endswith("/image"))
    views = [rrb.Spatial2DView(origin=f"{camera}/image", name="held green, lost red") for camera in cameras[:2]]
    errors = rrb.TimeSeriesView(
        origin=f"/{FUTURES}", name="error in the image, widths of a forearm", plot_legend=rrb.PlotLegend(visible=False)
    )
    text = rrb.TextDocumentView(origin="/why", name="what would have held the person")
    return page(rrb.Horizontal(rrb.Vertical(*views), rrb.Vertical(errors, text)), fps=None)
