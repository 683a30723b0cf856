"""The recorder: one Rerun file per run, published only when the run ends well."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import rerun as rr

from workbench.body.camera import Camera
from workbench.body.flexion import flexions
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.surface import person_surface
from workbench.body.surface_mesh import can_mesh
from workbench.core.frame import true_cameras
from workbench.core.resampling import systematic_indices
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.recording.write import (
    blueprint,
    columns,
    file,
    images,
    posterior,
    residuals,
    scene,
    trails,
    verdict_view,
)
from workbench.recording.write import checkpoints as stored
from workbench.recording.write import point_fit_views as fit
from workbench.recording.write import series_styles as styles
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

if TYPE_CHECKING:
    from rerun.chunk import Chunk

    from workbench.evaluation.evidence import Measured
    from workbench.evaluation.verdict import Verdict

FLUSH_EVERY = 3
"""Frames: two that a run has told may not be on the disk when it is killed. Fewer take longer, and more room."""
LONG, OF_LONG, MOST_TOGETHER = 100, 10, 60
"""After so many frames, a tenth of them, but at most two seconds of a video: the file's footer has a row for each piece
with a column for each of some 190 kinds of values, 8 kB a piece that stay in memory to the end."""
MOST_WAITING = 1_000_000
"""Bytes of one path: images do not wait longer, since writing takes several times their room."""
PICTURES_EVERY = 10  # frames, at most
_MOST_OVERLAID = 60  # more particles over an image hide the person


class Recorder:
    """Writes a run's steps to `path`, an .rrd, at the entity paths that readers depend on.

    A context manager, published as `RecordingFile` says, which also explains run_id, config_yaml, provenance, settings
    and live. The file is flushed every FLUSH_EVERY frames, less often in long runs.

    body, space: of the steps to come. n_particles_shown: skeletons drawn per frame at most. marginal_bins: bins of a
    marginal. coefficient_scale: (d,) standard deviations of the prior's Gaussian model for the columns `coefficients`.
    surface: record the expected pose's implicit surface as a mesh; without scikit-image a sentence says that there is
    none. checkpoints: store what the run needs to be continued, see `Checkpoints`; decode: of whoever makes the steps,
    states (N, D) to poses (N, P), without which nothing is stored. constant: metrics that say nothing, as
    they are the same in all runs of such parts: recorded, but not shown.
    Raises InputError when a number is out of range.

    Cameras stand still; images of one with distortion are straightened first, since the viewer's pinhole has none.
    Frames without views are shown by the way they go through the world.
    """

    def __init__(
        self, path: str | Path, body: Body, space: StateSpace, *, run_id: str, config_yaml: str,
        provenance: Mapping[str, Any], settings: Mapping[str, Any] | None = None, live: bool = False,
        n_particles_shown: int = 50,
        marginal_bins: int = 64, jpeg_quality: int = 80, surface: bool = False,
        coefficient_scale: FloatArray | None = None, checkpoints: bool = False,
        decode: Callable[[FloatArray], FloatArray] | None = None, constant: Sequence[str] = (),
    ) -> None:  # fmt: skip
        for name, value, lowest, highest in (
            ("n_particles_shown", n_particles_shown, 1, 10_000), ("marginal_bins", marginal_bins, 2, 1024),
            ("jpeg_quality", jpeg_quality, 1, 100),
        ):  # fmt: skip
            if not lowest <= value <= highest:
                raise InputError(f"recorder: {name} must lie between {lowest} and {highest}, found {value}")
        self._body, self._figure = body, scene.figure(body)
        self._posterior = posterior.Posterior(space, body.skeleton, coefficient_scale, marginal_bins)
        self._bands, self._columns = columns.Columns(), columns.Columns()
        self._checkpoints = stored.Checkpoints(decode) if checkpoints and decode is not None else None
        self._trails, self._ranks = trails.Trails(self._figure), posterior.Ranks()
        self._pictures: dict[str, images.Picture] = {}
        self._n_particles_shown, self._jpeg_quality = n_particles_shown, jpeg_quality
        self._n_frames = self._n_frames_pictured = self._n_waiting = 0
        self._diagnostics: tuple[str, ...] = ()
        self._constant, self._told = frozenset(constant), dict[str, int]()
        self._spans: dict[str, tuple[float, float]] = {}
        self._marks = False
        self._with_keypoints: set[str] = set()
        self._shown: blueprint.Shown | None = None
        self._warned, self._laid_out = False, True
        labels: dict[str, Any] = {"config_yaml": config_yaml, "provenance": provenance, "settings": settings}
        self._file = file.RecordingFile(path, run_id=run_id, live=live, **labels)
        self.path, self.part, self._stream = self._file.path, self._file.part, self._file.stream
        self._surface = person_surface(body) if surface and can_mesh() else None
        if surface and self._surface is None:
            self._file.warn("the surface is not drawn, only the limbs: its mesh needs scikit-image, the extra 'mesh'")

    def __enter__(self) -> Self:
        self._file.__enter__()
        skeleton = self._body.skeleton
        self._file.send_property("body", {"joints": skeleton.names, "pose": skeleton.dof_names})
        self._file.send_property("shape", self._body.shape.as_dict())
        self._file.send(scene.fixed(self._figure), static=True)
        self._stream.log("estimate/pose", rr.SeriesLines(names=list(skeleton.dof_names)), static=True)
        self._file.send(verdict_view.running(), static=True)
        self._flush()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._send_pictures()
            self._columns.write(self._stream)
        except BaseException as error:
            kind = type(error)
            raise
        finally:
            self._file.__exit__(kind)

    def take_over(
        self, chunks: "Sequence[Chunk]", frames: Sequence[int], poses: FloatArray, ranks: Iterable[FloatArray],
        picture: tuple[FloatArray, FloatArray, FloatArray],
    ) -> None:  # fmt: skip
        """Begin with the frames of an earlier recording of the same run, as its chunks have them.

        poses: (F, P), told of these frames. ranks: (k,) for each after the first. picture: the ends (K,) of the bins of
        their marginals and the log mass (K, B, F) in these; it is all that is left of their particles.
        """
        self._stream.send_chunks(chunks)
        self._posterior.take_over(frames, *picture)
        for each in ranks:
            self._ranks.take_over(each)
        paths = {chunk.entity_path for chunk in chunks}
        if any(path.startswith(f"/{scene.ESTIMATE}/trails") for path in paths):
            for pose in poses:
                self._trails.add(joints(self._body.skeleton, pose[None])[0])
        self._with_keypoints |= {path.split("/")[2] for path in paths if path.endswith("/keypoints")}
        self._warned = "/log" in paths
        if self._checkpoints is not None:
            sizes = [chunk.to_record_batch().nbytes for chunk in chunks if chunk.entity_path == f"/{stored.MEMORY}"]
            self._checkpoints.take_over(sum(sizes))
        self._n_frames = self._n_frames_pictured = len(frames)
        self._flush()

    def remember(self, before: Iterable[tuple[int, float, FloatArray, FloatArray]]) -> None:
        """Store, where checkpoints are, what going on needs of the frames before the first: number, time, s, and the
        poses (P,) that were told, and that the likelihood was told."""
        if self._checkpoints is not None:
            for frame, time_s, told, expected in before:
                self._columns.add(frame, _time(time_s), self._checkpoints.before(told, expected))

    def log(self, step: Step, metrics: Mapping[str, float]) -> None:
        """Record one step; metrics: this frame's numbers, in which `error...` get a view of their own.

        They are recorded with the effective sample size and the step's diagnostics.
        Raises ValueError for particles that are not finite or not normalised, InputError for a camera's unusable name,
        OSError when the disk is nearly full.
        """
        frame = step.frame
        time = _time(frame.time_s)
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", duration=time)
        measured = {"ess": step.ess, **step.diagnostics, **metrics}
        self._bands.add_numbers(frame.index, time, self._posterior.add(step))
        numbers = {f"metrics/{name}": value for name, value in measured.items()}
        numbers |= styles.guides(measured)
        numbers |= {} if frame.points is None else fit.curves(self._body.skeleton, step)
        self._columns.add_numbers(frame.index, time, numbers)
        self._file.send(fit.activities(step))
        ranks = self._ranks.add(step)
        self._told |= {name: self._told.get(name, 0) + 1 for name in measured}
        for path, value in ((f"metrics/{name}", value) for name, value in measured.items() if np.isfinite(value)):
            low, high = self._spans.get(path, (value, value))
            self._spans[path] = (min(low, value), max(high, value))
        self._diagnostics = tuple(step.diagnostics)
        if self._shown is None:  # what stays as the first step finds it
            self._file.send(self._posterior.begin(step), static=True)
            self._file.send(fit.fixed(self._legs(step)), static=True)
        self._lay_out(step, tuple(measured))
        pose = columns.curves({"estimate/pose": step.expected_pose})
        rows = chain(pose, self._scene(step), self._posterior.histograms(step))
        self._columns.add(frame.index, time, rows)
        if self._checkpoints is not None:
            self._columns.add(frame.index, time, self._checkpoints.beside(step, ranks))
            self._checkpoints.log(self._stream, step, self.part.stat().st_size)
        for sentence in (*self._file.warnings, *step.warnings):
            self._stream.log("log", rr.TextLog(sentence, level=rr.TextLogLevel.WARN))
        self._file.warnings.clear()
        self._n_frames, self._n_waiting = self._n_frames + 1, self._n_waiting + 1
        # Each picture holds all frames so far: sent at growing intervals, they keep long runs linear in size.
        # What was not in one when a run is killed is lost to who goes on from its checkpoints.
        growth = 1.1 if self._file.live else 2.5 if self._checkpoints is None else 1.5
        if self._n_frames % PICTURES_EVERY == 0 and self._n_frames >= growth * self._n_frames_pictured:
            self._send_pictures()
        self._columns.write_large(self._stream, MOST_WAITING)
        if self._file.live or self._n_waiting >= self._piece():
            self._flush()
            self._file.check_space()

    def set_verdict(self, verdict: "Verdict", measured: "Measured") -> None:
        """Record what became of the run as the property `verdict`, at the top of the page and as lanes, and how far it
        is from the keypoints; lay the page out anew, without curves of a single frame and with few frames' as marks."""
        self._file.send_property("verdict", {"kind": verdict.kind, "sentence": verdict.sentence})
        self._file.send(verdict_view.told(verdict), static=True)
        lanes = verdict_view.log_lanes(self._stream, verdict, measured)
        far = residuals.log_residuals(self._stream, measured)
        if self._shown is None or len(self._trails):
            return
        names = tuple(name for name in self._shown.metrics if self._told[name] > 1 or self._n_frames == 1)
        sparse = frozenset(name for name in names if self._told[name] < 0.5 * self._told["ess"])
        spans = self._spans | far if self._told["ess"] == self._n_frames else {}  # of earlier frames none is known
        self._shown = replace(
            self._shown, metrics=names, lanes=lanes, sparse=sparse, spans=spans, residuals=tuple(far),
            letters=len(verdict.sentence),
        )  # fmt: skip
        self._laid_out = False
        self._send_layout()

    def set_result(self, metrics: Mapping[str, float]) -> None:
        """Record the run's scalar results as the property `metrics`."""
        self._file.send_numbers("metrics", metrics)

    def set_stopped(self, sentence: str) -> None:
        """Record that the run is ended before its last frame, as status and the key `stopped` of the property `run`."""
        self._file.send_property("run", {"stopped": sentence})
        self._file.status = "stopped"

    def set_departures(self, departures: Mapping[str, FloatArray]) -> None:
        """Record how who and what is shown departs from what was told, as the property `departures`."""
        self._file.send_property("departures", departures)

    def set_cost(self, cost: Mapping[str, float]) -> None:
        """Record what the run took as the property `cost`, in which equal runs differ."""
        self._file.send_numbers("cost", cost)

    def _scene(self, step: Step) -> "columns.Rows":
        """Yield what the world and the images show; meshes, marks and keypoints are logged on the way."""
        figure, views = self._figure, step.frame.views
        true = scene.true_joints(figure.skeleton, step.frame.truth)
        # Equal indices would only draw the same skeleton again: its weight is in its colour.
        drawn = np.unique(systematic_indices(np.exp(step.log_weights), 0.5, self._n_particles_shown))
        cloud, shades = joints(figure.skeleton, step.poses[drawn]), scene.weight_colours(step.log_weights[drawn])
        yield from scene.estimate(figure, step.expected_pose)
        yield from scene.particles(figure, cloud, shades)
        yield from scene.bones(figure, scene.TRUTH, true)
        expected, every = joints(figure.skeleton, step.expected_pose[None]), -(-len(drawn) // _MOST_OVERLAID)
        for view, took in zip(views, true_cameras(step.frame), strict=True):
            shown = self._picture(view.camera)
            yield from images.image(shown, view.image, self._jpeg_quality)
            yield from images.overlay(shown, "particles", cloud[::every], figure.chains, shades[::every])
            yield from images.overlay(shown, "estimate", expected, figure.chains)
            yield from images.overlay(images.taken_by(shown, took), "truth", true, figure.chains)
            self._with_keypoints |= {view.camera.name} if view.keypoints is not None else set()
            if view.camera.name in self._with_keypoints:  # from the first on always, which clears those before
                self._file.send(images.keypoints(shown, view.keypoints, JOINT_NAMES))
        if step.frame.points is not None:
            yield from scene.points(step.frame.points, step.attachment)
        elif not views:
            self._trails.add(expected[0])
        if self._surface is not None:
            self._file.send(scene.skin(figure, self._surface, step.expected_pose))
        self._marks |= bool(views) and step.frame.truth is not None and step.frame.truth.marks is not None
        if views and self._marks:  # as the keypoints
            self._file.send(images.truth_marks(self._picture(views[0].camera), step.frame.truth, figure.skeleton.names))

    def _picture(self, camera: Camera) -> "images.Picture":
        if camera.name not in self._pictures:
            self._pictures[camera.name] = images.picture(camera)
            self._file.send(images.fixed(self._pictures[camera.name]), static=True)
        return self._pictures[camera.name]

    def _legs(self, step: Step) -> tuple[str, ...]:
        return () if step.frame.points is None else tuple(flexions(self._body.skeleton, step.expected_pose))

    def _lay_out(self, step: Step, metrics: Sequence[str]) -> None:
        """Lay the recording out by what there is to show; again when a metric or a warning comes for the first time."""
        before = self._shown or blueprint.Shown(
            cameras=[self._picture(view.camera) for view in step.frame.views],
            person=step.expected_pose[:3],
            towards=scene.seen_from(step),
            parameters=self._posterior.names,
            units=self._posterior.units,
            pictured=self._posterior.favourites,
            metrics=(),
            n_coefficients=len(self._posterior.coefficients),
            n_particles=len(step.particles),
            flexions=self._legs(step),
            activity=step.activity is not None,
            surface=self._surface is not None,
            warned=self._warned,
            constant=self._constant,
        )
        new = tuple(name for name in metrics if name not in before.metrics)
        warned, drawn = before.warned or bool(self._file.warnings or step.warnings), before.drawn | _drawn(step)
        if new or warned > before.warned or drawn > before.drawn:
            self._file.send(styles.fixed(new), static=True)
            self._shown = replace(before, metrics=(*before.metrics, *new), warned=warned, drawn=drawn)
            self._laid_out = False  # with what goes to the disk: the second frame has other metrics than the first

    def _send_layout(self) -> None:
        if self._shown is not None and not self._laid_out:
            self._stream.send_blueprint(blueprint.layout(self._shown))
        self._laid_out = True

    def _send_pictures(self) -> None:
        self._send_layout()  # before that of trails
        if self._n_frames > self._n_frames_pictured:
            self._bands.write(self._stream)  # a hundred curves: few long pieces of each take least room and time
            pictures, axes = self._posterior.pictures()
            self._file.send(pictures, static=True)  # so that every frame shows the whole run
            self._file.send_property("marginals", axes)
            self._file.send(self._ranks.pictures(), static=True)
            if len(self._trails):
                warned = self._shown is not None and self._shown.warned
                self._file.send(self._trails.pictures(), static=True)
                self._stream.send_blueprint(self._trails.layout(self._diagnostics, warned))
            self._n_frames_pictured = self._n_frames

    def _piece(self) -> int:
        """Tell how many frames go to the disk together."""
        in_long = min(self._n_frames // OF_LONG, MOST_TOGETHER) if self._n_frames >= LONG else 0
        return max(FLUSH_EVERY, in_long)

    def _flush(self) -> None:
        self._n_waiting = 0
        self._send_layout()
        self._columns.write(self._stream)
        self._file.flush()


def _drawn(step: Step) -> frozenset[str]:
    """Say which of `blueprint.KEY` a step shows."""
    known, views = step.frame.truth, step.frame.views
    shown = {
        "truth": known is not None and (known.joints is not None or known.pose is not None),
        "marks": bool(views) and known is not None and known.marks is not None,
        "particles": len(step.particles) > 1,
        "keypoints": any(view.keypoints is not None for view in views),
    }
    return frozenset(name for name, there in shown.items() if there)


def _time(time_s: float) -> np.timedelta64:
    return np.timedelta64(round(time_s * 1e9), "ns")
