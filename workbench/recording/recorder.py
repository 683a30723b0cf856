"""The recorder: one Rerun file per run, published only when the run ends well."""

import logging
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr
from rerun.chunk import RrdReader

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.errors import InputError
from workbench.inference.step import Step
from workbench.priors.state import StateSpace
from workbench.recording import images, scene, viewer
from workbench.recording.blueprint import layout
from workbench.recording.marginals import systematic
from workbench.recording.posterior import Posterior
from workbench.recording.series import Series

logger = logging.getLogger(__name__)

_MOST_OVERLAID = 60  # more particles over an image hide the person
_SPARE_BYTES = 100_000_000  # many times what is written between two flushes
_LONGEST_WRITE_S = 120.0


class Recorder:
    """Writes a run's steps to `path`, an .rrd, at the entity paths that readers depend on.

    A context manager. While it runs the file is called `<path>.part` and is readable up to the last flush, every
    `flush_every` frames, even when the process is killed. On a clean exit it becomes `path`; on an exception the
    .part is completed and kept, and nothing is published. The property `run` says which of these happened
    (status: running, failed, complete). Older files of these names are replaced.

    body, space: of the steps to come. run_id: unique per run. config_yaml: the resolved config. provenance: where the
    run came from (seed, versions). live: send every frame to a viewer too, if one listens at 127.0.0.1:9876.
    n_particles_shown: skeletons drawn per frame at most. marginal_bins: bins of a marginal.
    coefficient_scale: (d,) standard deviations of the prior's Gaussian model for the columns `coefficients`.
    Raises InputError when a number is out of range.

    Images of a camera with distortion are straightened first, since the viewer's pinhole has none. Cameras stand
    still. Times spent (Step.timing_s) are not recorded: they differ between equal runs.
    """

    def __init__(
        self,
        path: str | Path,
        body: Body,
        space: StateSpace,
        *,
        run_id: str,
        config_yaml: str,
        provenance: Mapping[str, str | float | int],
        application_id: str = "workbench",
        live: bool = False,
        n_particles_shown: int = 200,
        marginal_bins: int = 64,
        flush_every: int = 10,
        jpeg_quality: int = 85,
        coefficient_scale: FloatArray | None = None,
    ) -> None:
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self._body = body
        self._figure = scene.figure(body)
        self._posterior = Posterior(space, body.skeleton, coefficient_scale, marginal_bins)
        self._series = Series()
        self._pictures: dict[str, images.Picture] = {}
        self._run_id, self._config_yaml, self._provenance = run_id, config_yaml, provenance
        self._live, self._viewer_is_gone = live, False
        _check("n_particles_shown", n_particles_shown, 1, 10_000)
        _check("marginal_bins", marginal_bins, 2, 1024)
        _check("flush_every", flush_every, 1, 10_000)
        _check("jpeg_quality", jpeg_quality, 1, 100)
        self._n_particles_shown, self._flush_every, self._jpeg_quality = n_particles_shown, flush_every, jpeg_quality
        self._n_frames = self._n_frames_pictured = 0
        self._warnings: list[str] = []
        rr.set_strict_mode(True)
        # Without a batcher a chunk ends where we flush, so that equal runs give equal chunks.
        never = rr.ChunkBatcherConfig.NEVER()
        self._stream = rr.RecordingStream(application_id, recording_id=run_id, batcher_config=never)
        self._stream.set_log_time_enabled(False)

    def __enter__(self) -> Self:
        self.part.parent.mkdir(parents=True, exist_ok=True)
        sinks: list[Any] = [rr.FileSink(self.part)]
        if self._live and viewer.listens():
            sinks.append(rr.GrpcSink(viewer.URL))
        elif self._live:
            self._live = False
            self._warn(f"no viewer listens at {viewer.HOST}:{viewer.PORT}: recording to the file only")
        try:
            self._stream.set_sinks(*sinks)
        except RuntimeError as error:
            raise InputError(f"{self.part}: cannot be written: {error}") from None
        skeleton = self._body.skeleton
        self._send_property("run", {"id": self._run_id, "status": "running"})
        self._send_property("provenance", self._provenance)
        self._send_property("body", {"joints": skeleton.names, "pose": skeleton.dof_names})
        self._send_property("shape", self._body.shape.as_dict())
        self._stream.send_property("config", rr.TextDocument(self._config_yaml, media_type="text/plain"))
        self._send(scene.fixed(self._figure), static=True)
        self._stream.log("estimate/pose", rr.SeriesLines(names=list(skeleton.dof_names)), static=True)
        self._flush()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._send_property("run", {"status": "complete" if kind is None else "failed"})
        self._send_pictures()
        self._flush()
        self._stream.disconnect()  # not after a failed flush: it would wait for a writer that is gone
        if kind is not None:
            logger.warning("the run ended early; its first %d frames are in %s", self._n_frames, self.part)
            return
        RrdReader(self.part).store()  # raises if the last bytes did not reach the disk
        os.replace(self.part, self.path)

    def log(self, step: Step, metrics: Mapping[str, float]) -> None:
        """Record one step; metrics: this frame's numbers, in which `error...` get a view of their own.

        They are recorded with the effective sample size, the log evidence and the step's diagnostics.
        Raises ValueError for particles that are not finite or not normalised, InputError for a camera's unusable name,
        OSError when the disk is nearly full.
        """
        frame = step.frame
        time = np.timedelta64(round(frame.time_s * 1e9), "ns")
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", duration=time)
        measured = {"ess": step.ess, "log_evidence": step.log_evidence, **step.diagnostics, **metrics}
        self._series.add(frame.index, time, self._posterior.add(step))
        self._series.add(frame.index, time, {f"metrics/{name}": value for name, value in measured.items()})
        self._series.add(frame.index, time, {"estimate/pose": step.expected_pose})
        if self._n_frames == 0:
            self._begin(step, tuple(measured))
        self._log_scene(step)
        self._send(self._posterior.histograms(step))
        for sentence in (*self._warnings, *step.warnings):
            self._stream.log("log", rr.TextLog(sentence, level=rr.TextLogLevel.WARN))
        self._warnings.clear()
        self._n_frames += 1
        due = self._n_frames % self._flush_every == 0
        # Each picture holds all frames so far: sent at growing intervals, they keep long runs linear in size.
        if due and self._n_frames >= 1.1 * self._n_frames_pictured:
            self._send_pictures()
        if due or self._live:
            self._check_space()
            self._flush()

    def set_result(self, metrics: Mapping[str, float]) -> None:
        """Record the run's scalar results as the property `metrics`."""
        self._send_property("metrics", {name: float(value) for name, value in metrics.items()})

    def _log_scene(self, step: Step) -> None:
        figure, truth = self._figure, step.frame.truth
        true = scene.true_joints(figure.skeleton, truth)
        # Equal indices would only draw the same skeleton again: its weight is in its colour.
        drawn = np.unique(systematic(np.exp(step.log_weights), self._n_particles_shown))
        cloud, shades = joints(figure.skeleton, step.poses[drawn]), scene.weight_colours(step.log_weights[drawn])
        self._send(scene.estimate(figure, step.expected_pose))
        self._send(scene.particles(figure, cloud, shades))
        self._send(scene.truth(figure, true))
        expected, every = joints(figure.skeleton, step.expected_pose[None]), -(-len(drawn) // _MOST_OVERLAID)
        for view in step.frame.views:
            shown = self._picture(view.camera)
            self._send(images.image(shown, view.image, self._jpeg_quality))
            self._send(images.overlay(shown, "particles", cloud[::every], figure.chains, shades[::every]))
            self._send(images.overlay(shown, "estimate", expected, figure.chains))
            self._send(images.overlay(shown, "truth", true, figure.chains))
        if step.frame.views:
            first = self._picture(step.frame.views[0].camera)
            self._send(images.truth_marks(first, truth, figure.skeleton.names))

    def _picture(self, camera: Camera) -> images.Picture:
        if camera.name not in self._pictures:
            self._pictures[camera.name] = images.picture(camera)
            self._send(images.fixed(self._pictures[camera.name]), static=True)
        return self._pictures[camera.name]

    def _begin(self, step: Step, metrics: tuple[str, ...]) -> None:
        self._send(self._posterior.begin(step), static=True)
        posterior, person = self._posterior, step.expected_pose[:3]
        cameras = [self._picture(view.camera) for view in step.frame.views]
        n_coefficients = len(posterior.coefficients)
        self._stream.send_blueprint(
            layout(cameras, person, posterior.names, posterior.favourites, metrics, n_coefficients)
        )

    def _send_pictures(self) -> None:
        if self._n_frames > self._n_frames_pictured:
            pictures, axes = self._posterior.pictures()
            self._send(pictures, static=True)  # so that every frame shows the whole run
            self._send_property("marginals", axes)
            self._n_frames_pictured = self._n_frames

    def _send(self, entities: Iterable[tuple[str, rr.AsComponents]], static: bool = False) -> None:
        for path, archetype in entities:
            self._stream.log(path, archetype, static=static)

    def _send_property(self, name: str, values: Mapping[str, Any]) -> None:
        # As Arrow arrays: AnyValues would hold every later run of the process to the first one's types.
        arrays = {key: pa.array(np.atleast_1d(np.asarray(value)).tolist()) for key, value in values.items()}
        if arrays:
            self._stream.send_property(name, rr.AnyValues(**arrays))

    def _warn(self, sentence: str) -> None:
        logger.warning(sentence)
        self._warnings.append(sentence)

    def _check_space(self) -> None:
        # Rerun's writer never comes back from a full disk, so the run ends while there is room to close the file.
        if (free := shutil.disk_usage(self.part.parent).free) < _SPARE_BYTES:
            raise OSError(f"{self.part}: only {free / 1e6:.0f} MB are left on the disk, the recording ends here")

    def _flush(self) -> None:
        self._series.write(self._stream)
        try:
            self._stream.flush(timeout_sec=_LONGEST_WRITE_S)
        except RuntimeError as error:
            if not self._live or "gRPC" not in str(error):
                raise OSError(f"{self.part}: writing failed, {error}") from error
            if not self._viewer_is_gone:
                self._warn(f"the viewer at {viewer.HOST}:{viewer.PORT} is gone: recording to the file only")
            self._viewer_is_gone = True


def _check(name: str, value: int, lowest: int, highest: int) -> None:
    if not lowest <= value <= highest:
        raise InputError(f"recorder: {name} must lie between {lowest} and {highest}, found {value}")
