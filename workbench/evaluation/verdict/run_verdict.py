"""The verdict on a run: trustworthy, doubtful or not usable, and why.

A ground truth or annotations decide whether the person was tracked, where there are any; otherwise keypoints do. In any
case the configured inputs are compared with the measurements. Thresholds come from anatomy, from differences between
people and detectors, or from reasoning; none was fitted to failed runs.
"""

from dataclasses import dataclass, replace
from typing import Any

from workbench.evaluation.verdict.run_findings import RunInputs, run_findings
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.time_findings import coverage
from workbench.evaluation.verdict.track_outcome import outcome
from workbench.utils.finding import Finding, conclusion, level_of, problems


@dataclass(frozen=True)
class Verdict:
    """The verdict on a run.

    findings: problems, the worst first. outcome: whether the person was tracked, of kind "tracked", "lost", "no ground
    truth" or "no person visible". states: (F,) by frame, "tracked", "doubtful", "lost", "not known" in a frame without
    errors, or "" in a run without errors.
    """

    findings: tuple[Finding, ...]
    outcome: Finding
    states: tuple[str, ...]

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
    result, states = outcome(measured, inputs.shows_person)
    if (covered := coverage(inputs.input_counts)) is not None and not covered.is_problem:
        result = replace(result, message=f"{result.message}, {covered.message}")
    worst = {each.kind: each for each in reversed(problems(run_findings(measured, inputs)))}  # the first of a kind
    return Verdict(tuple(reversed(worst.values())), result, states)
