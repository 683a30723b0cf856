"""The verdict on a run: trustworthy, doubtful or not usable, and why.

A ground truth or annotations decide whether the person was tracked, where there are any; otherwise keypoints do. In any
case the configured inputs are compared with the measurements. Thresholds come from anatomy, from differences between
people and detectors, or from reasoning; none was fitted to failed runs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from workbench.evaluation.verdict.joint_states import JOINT_GROUPS, joint_states
from workbench.evaluation.verdict.run_findings import RunInputs, run_findings
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.time_findings import lost_person, tracked_frames
from workbench.evaluation.verdict.track_outcome import outcome
from workbench.evaluation.verdict.video_findings import video_findings
from workbench.utils.finding import Finding, conclusion, level_of, problems


@dataclass(frozen=True)
class Verdict:
    """The verdict on a run.

    findings: problems, the worst first, then notes. outcome: whether the person was tracked, of kind "tracked", "lost",
    "no ground truth" or "no person visible". states: (F,) by frame, "tracked", "doubtful", "lost", "not known" in a
    frame without errors, or "" in a run without errors. joint_states: (F,) of each of JOINT_GROUPS, the worst of its
    joints; "not seen" where no camera sees any of them. Empty in a run without errors.
    """

    findings: tuple[Finding, ...]
    outcome: Finding
    states: tuple[str, ...]
    joint_states: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def level(self) -> str:
        """The worst level of the findings and the outcome: "trustworthy", "doubtful" or "not usable"."""
        return level_of((*self.findings, self.outcome))

    @property
    def kind(self) -> str:
        """The kind of the worst finding, or the outcome's."""
        return next((each.kind for each in problems((*self.findings, self.outcome))), self.outcome.kind)

    @property
    def message(self) -> str:
        """The level with its reasons, then the outcome."""
        text = conclusion((*self.findings, self.outcome))
        return text if self.outcome.message in text else f"{text}: {self.outcome.message}"

    @property
    def as_dict(self) -> dict[str, Any]:
        """The verdict without the states, for JSON."""
        every = (*self.findings, self.outcome)
        findings = [{"level": each.level, "kind": each.kind, "message": each.message} for each in every]
        head = {"level": self.level, "outcome": self.outcome.kind, "kind": self.kind, "message": self.message}
        return head | {"findings": findings}


def verdict(measured: RunMeasurements, inputs: RunInputs) -> Verdict:
    """Return the verdict on a run from its measurements and inputs."""
    joints = joint_states(measured)
    result, states = outcome(measured, joints, inputs.shows_person)
    if n_tracked := tracked_frames(measured, inputs.input_counts, states):
        result = replace(result, message=f"{result.message}, {n_tracked}")
    notes = [each for each in video_findings(inputs.input_counts) if not each.is_problem]
    result = replace(result, message=", ".join([result.message, *(each.message for each in notes)]))
    lost = lost_person(measured, inputs.input_counts, states)
    findings = problems([*([] if lost is None else [lost]), *run_findings(measured, joints, inputs)])
    worst = {each.kind: each for each in reversed(findings)}  # the first of a kind
    by_group = {group: joints.of_joints(names) for group, names in JOINT_GROUPS.items()}
    return Verdict((*reversed(worst.values()), *notes), result, states, by_group if joints.compared.any() else {})
