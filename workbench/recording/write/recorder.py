"""The recorder: one Rerun file per run, published only when the run ends well."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np
import rerun as rr

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.flexion import flexions
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.surface import person_surface
from workbench.body.surface_mesh import can_mesh
from workbench.core.frame import true_cameras
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.errors import InputError
from workbench.recording.write import blueprint, images, scene
from workbench.recording.write import point_fit_views as fit
from workbench.recording.write import series_styles as styles
from workbench.recording.write.columns import Columns, Rows, curves
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.marginals import systematic
from workbench.recording.write.posterior import Posterior, Ranks
from workbench.recording.write.trails import Trails

FLUSH_EVERY = 10  # frames
_MOST_OVERLAID = 60  # more particles over an image hide the person


class Recorder:
    """Writes a run's steps to `path`, an .rrd, at the entity paths that readers depend on.

    A context manager, published as `RecordingFile` says, which also explains run_id, config_yaml, provenance and live.
    The file is flushed every FLUSH_EVERY frames.

    body, space: of the steps to come. n_particles_shown: skeletons drawn per frame at most. marginal_bins: bins of a
    marginal. coefficient_scale: (d,) standard deviations of the prior's Gaussian model for the columns `coefficients`.
    surface: record the expected pose's implicit surface as a mesh; without scikit-image a sentence says that there is
    none. Raises InputError when a number is out of range.

    Cameras stand still; images of one with distortion are straightened first, since the viewer's pinhole has none.
    Frames without views are shown by the way they go through the world.
    """

    def __init__(
        self, path: str | Path, body: Body, space: StateSpace, *, run_id: str, config_yaml: str,
        provenance: Mapping[str, Any], live: bool = False, n_particles_shown: int = 50,
        marginal_bins: int = 64, jpeg_quality: int = 80, surface: bool = False,
        coefficient_scale: FloatArray | None = None,
    ) -> None:  # fmt: skip
        for name, value, lowest, highest in (
            ("n_particles_shown", n_particles_shown, 1, 10_000), ("marginal_bins", marginal_bins, 2, 1024),
            ("jpeg_quality", jpeg_quality, 1, 100),
        ):  # fmt: skip
            if not lowest <= value <= highest:
                raise InputError(f"recorder: {name} must lie between {lowest} and {highest}, found {value}")
        self._body, self._figure = body, scene.figure(body)
        self._posterior = Posterior(space, body.skeleton, coefficient_scale, marginal_bins)
        self._bands, self._columns = Columns(), Columns()
        self._trails, self._ranks = Trails(self._figure), Ranks()
        self._pictures: dict[str, images.Picture] = {}
        self._n_particles_shown, self._jpeg_quality = n_particles_shown, jpeg_quality
        self._n_frames = self._n_frames_pictured = 0
        self._diagnostics: tuple[str, ...] = ()
        self._marks = False
        self._with_keypoints: set[str] = set()
        self._shown: blueprint.Shown | None = None
        self._file = RecordingFile(path, run_id=run_id, config_yaml=config_yaml, provenance=provenance, live=live)
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
        self._flush()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._send_pictures()
        self._columns.write(self._stream)
        self._file.__exit__(kind)

    def log(self, step: Step, metrics: Mapping[str, float]) -> None:
        """Record one step; metrics: this frame's numbers, in which `error...` get a view of their own.

        They are recorded with the effective sample size and the step's diagnostics.
        Raises ValueError for particles that are not finite or not normalised, InputError for a camera's unusable name,
        OSError when the disk is nearly full.
        """
        frame = step.frame
        time = np.timedelta64(round(frame.time_s * 1e9), "ns")
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", duration=time)
        measured = {"ess": step.ess, **step.diagnostics, **metrics}
        self._bands.add(frame.index, time, curves(self._posterior.add(step)))
        numbers = {f"metrics/{name}": value for name, value in measured.items()} | {"estimate/pose": step.expected_pose}
        numbers |= {} if frame.points is None else fit.curves(self._body.skeleton, step)
        self._file.send(fit.activities(step))
        self._ranks.add(step)
        self._diagnostics = tuple(step.diagnostics)
        if self._n_frames == 0:  # what stays as the first step finds it
            self._file.send(self._posterior.begin(step), static=True)
            self._file.send(fit.fixed(self._legs(step)), static=True)
        self._lay_out(step, tuple(measured))
        rows = chain(curves(numbers), self._scene(step), self._posterior.histograms(step))
        self._columns.add(frame.index, time, rows)
        for sentence in (*self._file.warnings, *step.warnings):
            self._stream.log("log", rr.TextLog(sentence, level=rr.TextLogLevel.WARN))
        self._file.warnings.clear()
        self._n_frames += 1
        due = self._n_frames % FLUSH_EVERY == 0
        # Each picture holds all frames so far: sent at growing intervals, they keep long runs linear in size.
        growth = 1.1 if self._file.live else 2.5
        if due and self._n_frames >= growth * self._n_frames_pictured:
            self._send_pictures()
        if due or self._file.live:
            self._file.check_space()
            self._flush()

    def set_result(self, metrics: Mapping[str, float]) -> None:
        """Record the run's scalar results as the property `metrics`."""
        self._file.send_property("metrics", metrics)

    def set_departures(self, departures: Mapping[str, FloatArray]) -> None:
        """Record how who and what is shown departs from what was told, as the property `departures`."""
        self._file.send_property("departures", departures)

    def set_cost(self, cost: Mapping[str, float]) -> None:
        """Record what the run took as the property `cost`, in which equal runs differ."""
        self._file.send_property("cost", cost)

    def _scene(self, step: Step) -> Rows:
        """Yield what the world and the images show; meshes, marks and keypoints are logged on the way."""
        figure, views = self._figure, step.frame.views
        true = scene.true_joints(figure.skeleton, step.frame.truth)
        # Equal indices would only draw the same skeleton again: its weight is in its colour.
        drawn = np.unique(systematic(np.exp(step.log_weights), self._n_particles_shown))
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

    def _picture(self, camera: Camera) -> images.Picture:
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
        )
        new = tuple(name for name in metrics if name not in before.metrics)
        warned = before.warned or bool(self._file.warnings or step.warnings)
        if new or warned > before.warned:
            self._file.send(styles.fixed(new), static=True)
            self._shown = replace(before, metrics=(*before.metrics, *new), warned=warned)
            self._stream.send_blueprint(blueprint.layout(self._shown))

    def _send_pictures(self) -> None:
        if self._n_frames > self._n_frames_pictured:
            self._bands.write(self._stream)  # a hundred curves: few long pieces of each take least room and time
            pictures, axes = self._posterior.pictures()
            self._file.send(pictures, static=True)  # so that every frame shows the whole run
            self._file.send_property("marginals", axes)
            self._file.send(self._ranks.pictures(), static=True)
            if len(self._trails):
                self._file.send(self._trails.pictures(), static=True)
                self._stream.send_blueprint(self._trails.layout(self._diagnostics))
            self._n_frames_pictured = self._n_frames

    def _flush(self) -> None:
        self._columns.write(self._stream)
        self._file.flush()
