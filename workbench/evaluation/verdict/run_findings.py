"""Findings on a run: contradictions between its inputs, its observations, its estimate and its stated uncertainty."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from workbench.evaluation.verdict.dropped_findings import dropped_findings
from workbench.evaluation.verdict.frozen_findings import frozen_findings
from workbench.evaluation.verdict.identity_findings import identity_findings
from workbench.evaluation.verdict.input_findings import input_findings
from workbench.evaluation.verdict.joint_findings import joint_findings
from workbench.evaluation.verdict.joint_states import JointStates
from workbench.evaluation.verdict.keypoint_findings import keypoint_findings
from workbench.evaluation.verdict.motion_findings import motion_findings
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.support_findings import support_findings
from workbench.evaluation.verdict.time_findings import time_findings
from workbench.evaluation.verdict.uncertainty_findings import uncertainty_findings
from workbench.evaluation.verdict.video_findings import video_findings
from workbench.utils.finding import NOT_USABLE, Finding, level_of

MOVING_CAMERA = "moving camera"
"""Kind of the finding that the camera travels."""


@dataclass(frozen=True)
class RunInputs:
    """Configured inputs of a run.

    height_m: the person's. rate_hz, source_rate_hz: configured rate of the frames, and the rate in their source's file.
    shows_person: the dataset has observations of the person. input_counts: of the frames in which a person was selected
    among the detected ones, see `TargetPerson`; empty without detections. camera_travels: the only camera changes its
    place.
    """

    height_m: float | None = None
    rate_hz: float | None = None
    source_rate_hz: float | None = None
    shows_person: bool = True
    input_counts: Mapping[str, int] = field(default_factory=dict)
    camera_travels: bool = False


def run_findings(measured: RunMeasurements, joints: JointStates, inputs: RunInputs) -> Iterator[Finding]:
    """Yield the findings on a run, those on its inputs first."""
    of_inputs = [
        *input_findings(measured, inputs.height_m),
        *time_findings(measured, inputs.rate_hz, inputs.source_rate_hz),
        *dropped_findings(measured),
        *frozen_findings(measured),
        *keypoint_findings(measured),
        *identity_findings(measured),
    ]
    yield from of_inputs
    yield from video_findings(inputs.input_counts)
    if inputs.camera_travels:
        yield Finding(MOVING_CAMERA, "the camera travels: positions are relative to the camera, not to the ground")
    if level_of(of_inputs) != NOT_USABLE:  # otherwise a consequence
        yield from joint_findings(measured, joints)
        yield from motion_findings(measured, inputs.height_m)
        yield from support_findings(measured)
    yield from uncertainty_findings(measured)
