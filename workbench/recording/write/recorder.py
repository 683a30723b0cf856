"""The recorder of a run's steps: one Rerun file per run."""

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import chain
from pathlib import Path
from time import monotonic
from typing import Any, Self

import numpy as np
import rerun as rr

from workbench.body.angles import flexions
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES, Skeleton
from workbench.body.surface import person_surface
from workbench.body.surface_mesh import can_mesh
from workbench.cameras.camera import Camera
from workbench.core.frame import Frame, View, true_cameras
from workbench.core.resampling import systematic_indices
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.evaluation.uncertainty.step_calibration import pose_ranks
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.run_verdict import Verdict
from workbench.recording.write import columns, file, images, layout, outcome, posterior, scene, styles
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.signals import deferred

FLUSH_S, FLUSH_FRACTION, MAX_FLUSH_EVERY = 1.0, 0.05, 300
"""Seconds between two flushes, or this fraction of the run's seconds so far, and frames at most: the work that is lost
when a run is killed. The file's footer has a row for each chunk with a column for each of some 190 kinds of values,
8 kB a chunk, which stay in memory to the end."""
MAX_BUFFERED_BYTES = 1_000_000
"""Buffered bytes of one path, such as images, since writing takes several times their memory."""
_PICTURES_EVERY = 10  # frames, at least
_MAX_OVERLAID = 60  # more particles over an image hide the person
_RANGES = {"n_particles_shown": (1, 10_000), "marginal_bins": (2, 1024), "jpeg_quality": (1, 100)}


class Recorder:
    """Writes a run's steps to `path`, an .rrd, at the entity paths that readers depend on; `n_flushed` of them are on
    the disk.

    It is a context manager, published as `RecordingFile` is. The file is flushed every FLUSH_S, less often in long
    runs. Images are encoded on a thread while the next step is computed. Cameras are static; their images are
    undistorted, since the viewer's pinhole has no distortion. A run without views is shown by its path.

    Parameters
    ----------
    body, space : of the steps to come.
    run_id, config_yaml, provenance, settings, stream : see `RecordingFile`.
    n_particles_shown : largest number of skeletons per frame.
    marginal_bins : bins of a marginal.
    surface : record the expected pose's implicit surface as a mesh; without scikit-image there is a warning instead.
    video : store source_video, an MP4 file, in place of a JPEG of every image: about a tenth of the size. The viewer
        decodes it, H.264 by an installed FFmpeg or in a browser.
    source_video : file whose frames are the images of the only camera, see `SequenceInfo.video`.
    camera_turns : the only camera turns or zooms, and is recorded in each frame.
    uninformative_metrics : equal in all runs of such components; recorded, but not shown.

    Raises
    ------
    InputError : a number is out of range, or video without a source_video that Rerun reads.
    """

    def __init__(
        self, path: str | Path, body: Body, space: StateSpace, *, run_id: str, config_yaml: str,
        provenance: Mapping[str, Any], settings: Mapping[str, Any] | None = None, stream: bool = False,
        n_particles_shown: int = 20, marginal_bins: int = 64, jpeg_quality: int = 80, surface: bool = False,
        video: bool = False, source_video: Path | None = None, camera_turns: bool = False,
        uninformative_metrics: Sequence[str] = (),
    ) -> None:  # fmt: skip
        values = (n_particles_shown, marginal_bins, jpeg_quality)
        for (name, (low, high)), value in zip(_RANGES.items(), values, strict=True):
            if not low <= value <= high:
                raise InputError(f"recorder: {name} must lie between {low} and {high}, found {value}")
        self._body, self._figure = body, scene.figure(body)
        self._posterior = posterior.Posterior(space, body.skeleton, marginal_bins)
        self._intervals, self._columns = columns.Columns(), columns.Columns()
        self._ranks: list[FloatArray] = []  # (k,) by frame; the first pose is given and has none
        self._places: list[FloatArray] = []  # (J, 3) by frame, of a run without images
        self._cameras: dict[str, images.RecordedCamera] = {}
        self._camera_turns = camera_turns
        self._lens: FloatArray | None = None  # of a camera that turns
        self._n_particles_shown, self._jpeg_quality = n_particles_shown, jpeg_quality
        self._n_frames = self._n_frames_pictured = self.n_flushed = 0
        self._began_s = self._flushed_s = monotonic()
        if video and source_video is None:
            raise InputError(
                "recorder.video: expected a dataset of one MP4 video without rotation, scaling and lens distortion; "
                "leave recorder.video out, and the images are recorded one by one"
            )
        self._video = images.video_clip(source_video) if video and source_video is not None else None
        self._encoder = ThreadPoolExecutor(1, "image_encoder")
        self._encoded: list[tuple[int, np.timedelta64, str, Future[ByteArray]]] = []  # of the last frame
        self._diagnostics: tuple[str, ...] = ()
        self._uninformative, self._n_values = frozenset(uninformative_metrics), Counter[str]()
        self._has_annotations, self._with_keypoints = False, set[str]()
        self._layout_input: layout.LayoutInput | None = None
        self._sent_layout: layout.LayoutInput | None = None
        self._file = file.RecordingFile(
            path, run_id=run_id, config_yaml=config_yaml, provenance=provenance, settings=settings, stream=stream
        )
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
        self._stream.log(outcome.VERDICT, outcome.verdict_text(), static=True)
        self._flush()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._send_pictures()
            self._write_columns()
        except BaseException as error:
            kind = type(error)
            raise
        finally:
            self._encoder.shutdown(cancel_futures=True)
            self._file.__exit__(kind)

    def log(self, step: Step, metrics: Mapping[str, float]) -> None:
        """Record one step with its metrics, the effective sample size and its diagnostics.

        metrics: the frame's numbers by name; joint errors share plots. Raises ValueError for particles that are not
        finite or not normalised, InputError for a reserved name of a camera, OSError when the disk is nearly full.
        """
        frame, time = step.frame, columns.nanoseconds(step.frame.time_s)
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", duration=time)
        measured = {"ess": step.ess, **step.diagnostics, **metrics}
        intervals = self._posterior.add(step)
        self._intervals.add_numbers(frame.index, time, intervals)
        numbers = {f"metrics/{name}": value for name, value in measured.items()} | styles.guides(measured)
        numbers |= {} if frame.points is None else scene.flexion_angles(self._body.skeleton, step)
        self._columns.add_numbers(frame.index, time, numbers)
        self._file.send(scene.activities(step))
        self._ranks.append(pose_ranks(step) if self._ranks else np.zeros(0))
        self._n_values.update(measured.keys())
        self._diagnostics = tuple(step.diagnostics)
        if self._layout_input is None:
            self._file.send(chain(self._posterior.begin(step), scene.flexion_lines(self._flexions(step))), static=True)
        self._lay_out(step, tuple(measured))
        poses = {"estimate/pose": columns.Row(rr.Scalars, {"scalars": np.array(step.expected_pose, dtype=np.float64)})}
        if step.draws is not None:
            poses["estimate/draws"] = columns.Row(rr.DynamicArchetype, {"poses": step.draws.astype(np.float32).ravel()})
        self._add_images()
        rows = chain(poses.items(), self._scene(step), self._posterior.histograms(step))
        self._columns.add(frame.index, time, rows)
        for message in (*self._file.warnings, *step.warnings):
            self._stream.log("log", rr.TextLog(message, level=rr.TextLogLevel.WARN))
        self._file.warnings.clear()
        self._n_frames += 1
        self._file.write(self._columns, min_bytes=MAX_BUFFERED_BYTES)
        now, n_buffered = monotonic(), self._n_frames - self.n_flushed
        is_due = now - self._flushed_s >= max(FLUSH_S, FLUSH_FRACTION * (now - self._began_s))
        if self._file.is_streaming or n_buffered >= MAX_FLUSH_EVERY or is_due:
            # Each picture has all frames so far: sent at growing intervals, they keep long runs linear in size.
            growth = 1.1 if self._file.is_streaming else 2.5
            if self._n_frames >= max(growth * self._n_frames_pictured, self._n_frames_pictured + _PICTURES_EVERY):
                self._send_pictures()
            self._flush()
            self._file.check_space()

    def set_verdict(self, verdict: Verdict, measured: RunMeasurements) -> None:
        """Record the verdict as a property, as text and as lanes of states, and reprojection errors; update the layout.

        Curves of a single frame are then hidden, and curves of few frames are drawn as points.
        """
        properties = {name: verdict.as_dict[name] for name in ("level", "outcome", "kind", "message")}
        self._file.send_property("verdict", properties)
        self._stream.log(outcome.VERDICT, outcome.verdict_text(verdict.message), static=True)
        lanes = outcome.log_lanes(self._stream, verdict, measured)
        reprojection = outcome.log_reprojection_errors(self._stream, measured)
        if self._layout_input is None or self._places:
            return
        n_values = self._n_values
        names = tuple(name for name in self._layout_input.metrics if n_values[name] > 1 or self._n_frames == 1)
        sparse = frozenset(name for name in names if n_values[name] < 0.5 * n_values["ess"])
        self._layout_input = replace(
            self._layout_input, metrics=names, lanes=lanes, sparse=sparse, reprojection_errors=reprojection,
            n_characters=len(verdict.message),
        )  # fmt: skip
        self._send_layout()

    def set_result(self, metrics: Mapping[str, float]) -> None:
        """Record the run's metrics as the property `metrics`."""
        self._file.send_numbers("metrics", metrics)

    def set_stopped(self, reason: str) -> None:
        """Record an end before the last frame, as status and as the key `stopped` of the property `run`."""
        self._file.send_property("run", {"stopped": reason})
        self._file.status = "stopped"

    def set_perturbations(self, perturbations: Mapping[str, FloatArray]) -> None:
        """Record how the person and the cameras differ from the assumed ones, as the property `perturbations`."""
        self._file.send_property("perturbations", perturbations)

    def set_cost(self, cost: Mapping[str, float]) -> None:
        """Record the run's cost as the property `cost`, which differs between equal runs."""
        self._file.send_numbers("cost", cost)

    def _scene(self, step: Step) -> columns.Rows:
        """Yield the rows of the world and the images, and log meshes, annotations and keypoints."""
        figure, views, truth = self._figure, step.frame.views, step.frame.truth
        true = scene.true_joints(figure.skeleton, truth)
        # Equal indices would only draw the same skeleton again: its weight is in its colour.
        drawn = np.unique(systematic_indices(np.exp(step.log_weights), 0.5, self._n_particles_shown))
        cloud, shades = joints(figure.skeleton, step.poses[drawn]), scene.weight_colours(step.log_weights[drawn])
        frames = step.expected_frames(figure.skeleton)
        yield from scene.estimate(figure, frames)
        yield from scene.particles(figure, cloud, shades)
        yield from scene.bones(figure, scene.TRUTH, true)
        expected, every = frames.positions, -(-len(drawn) // _MAX_OVERLAID)
        for view, true_camera in zip(views, true_cameras(step.frame), strict=True):
            recorded = self._camera(view.camera)
            if self._camera_turns:
                recorded = self._turned(recorded, view.camera)
                yield from images.turn(recorded)
            self._encode(step.frame, recorded, view.image)
            yield from images.overlay(recorded, "particles", cloud[::every], figure.chains, shades[::every])
            yield from images.overlay(recorded, "estimate", expected, figure.chains)
            yield from images.overlay(recorded, "truth", true, figure.chains, true_camera=true_camera)
            if view.keypoints is not None and view.camera.name not in self._with_keypoints:
                self._file.send(images.keypoint_style(recorded), static=True)
                self._with_keypoints.add(view.camera.name)
            if view.camera.name in self._with_keypoints:  # always from the first on, to clear earlier ones
                yield from images.keypoints(recorded, *_observed(view, figure.skeleton))
        if step.frame.points is not None:
            yield from scene.points(step.frame.points, step.attachment)
        elif not views:
            self._places.append(expected[0])
        if self._surface is not None:
            self._file.send(scene.skin(figure, self._surface, step.expected_pose))
        self._has_annotations |= bool(views) and truth is not None and truth.annotations is not None
        if views and self._has_annotations:  # as the keypoints
            self._file.send(images.annotations(self._camera(views[0].camera), truth, figure.skeleton.names))

    def _encode(self, frame: Frame, recorded: images.RecordedCamera, pixels: ByteArray) -> None:
        if self._video is not None:
            row = images.video_row(recorded, self._video[1], frame.index)
            self._columns.add(frame.index, columns.nanoseconds(frame.time_s), row)
            return
        with deferred():  # else Python may wait at exit for a thread that is not listed in its pool
            jpeg = self._encoder.submit(images.jpeg, recorded, pixels, self._jpeg_quality)
        self._encoded.append((frame.index, columns.nanoseconds(frame.time_s), f"{recorded.path}/image", jpeg))

    def _camera(self, camera: Camera) -> images.RecordedCamera:
        if camera.name not in self._cameras:
            self._cameras[camera.name] = images.recorded_camera(camera)
            self._file.send(images.fixed(self._cameras[camera.name], self._camera_turns), static=True)
            if self._video is not None:
                video = [(images.video_path(self._cameras[camera.name]), self._video[0])]
                self._file.send(iter(video), static=True)
        return self._cameras[camera.name]

    def _turned(self, recorded: images.RecordedCamera, camera: Camera) -> images.RecordedCamera:
        """Return the recorded camera of a frame, and record its lens where it differs from the frame's before."""
        turned = images.turned(recorded, camera)
        if self._lens is None or not np.array_equal(self._lens, camera.matrix):
            self._file.send(images.zoom(turned))
            self._lens = camera.matrix
        return turned

    def _flexions(self, step: Step) -> tuple[str, ...]:
        return () if step.frame.points is None else tuple(flexions(self._body.skeleton, step.expected_pose))

    def _lay_out(self, step: Step, metrics: Sequence[str]) -> None:
        """Update the layout when a metric, a warning or an overlay occurs for the first time."""
        before = self._layout_input or layout.LayoutInput(
            cameras=[self._camera(view.camera) for view in step.frame.views],
            person=step.expected_pose[:3],
            towards=scene.viewpoint(step),
            posterior=self._posterior,
            metrics=(),
            n_particles=len(step.particles),
            flexions=self._flexions(step),
            activity=step.activity is not None,
            surface=self._surface is not None,
            uninformative=self._uninformative,
        )
        new = tuple(name for name in metrics if name not in before.metrics)
        warned, drawn = before.warned or bool(self._file.warnings or step.warnings), before.drawn | _drawn(step)
        if new or warned > before.warned or drawn > before.drawn:
            self._file.send(styles.metric_lines(new), static=True)
            # sent at the next flush, since the second frame has more metrics than the first
            self._layout_input = replace(before, metrics=(*before.metrics, *new), warned=warned, drawn=drawn)

    def _send_layout(self) -> None:
        if self._layout_input is not None and self._layout_input is not self._sent_layout:
            self._stream.send_blueprint(layout.layout(self._layout_input))
        self._sent_layout = self._layout_input

    def _send_pictures(self) -> None:
        self._send_layout()  # before the layout of trails
        if self._n_frames == self._n_frames_pictured:
            return
        self._file.write(self._intervals)  # some hundred curves: few long chunks of each are smallest and fastest
        pictures, axes = self._posterior.pictures()  # of the whole run
        self._file.send(chain(pictures, posterior.rank_pictures(self._ranks)), static=True)
        self._file.send_property("marginals", axes)
        if self._places:
            places, warned = np.stack(self._places), self._layout_input is not None and self._layout_input.warned
            self._file.send(scene.trails(self._figure, places), static=True)
            dof_names = self._body.skeleton.dof_names
            self._stream.send_blueprint(layout.trails_layout(places, dof_names, self._diagnostics, warned))
        self._n_frames_pictured = self._n_frames

    def _flush(self) -> None:
        self._send_layout()
        self._write_columns()
        self._file.flush()
        self.n_flushed, self._flushed_s = self._n_frames, monotonic()

    def _write_columns(self) -> None:
        self._add_images()
        self._file.write(self._columns)

    def _add_images(self) -> None:
        """Add the encoded images of the last frame to the columns."""
        for frame, time, path, jpeg in self._encoded:
            row = columns.Row(rr.EncodedImage, {"blob": [jpeg.result()], "media_type": ["image/jpeg"]})
            self._columns.add(frame, time, [(path, row)])
        self._encoded.clear()


def _observed(view: View, skeleton: Skeleton) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return a view's keypoints (n, 3), with those of the feet for a skeleton that has them, and their names."""
    if view.keypoints is None or view.feet is None or not skeleton.has_feet:
        return view.keypoints, JOINT_NAMES
    return np.concatenate([view.keypoints, view.feet]), (*JOINT_NAMES, *FOOT_POINTS)


def _drawn(step: Step) -> frozenset[str]:
    """Return the keys of `layout.KEY` that a step shows."""
    truth, views = step.frame.truth, step.frame.views
    shown = {
        "truth": truth is not None and (truth.joints is not None or truth.pose is not None),
        "annotations": bool(views) and truth is not None and truth.annotations is not None,
        "particles": len(step.particles) > 1,
        "keypoints": any(view.keypoints is not None for view in views),
    }
    return frozenset(name for name, is_shown in shown.items() if is_shown)
