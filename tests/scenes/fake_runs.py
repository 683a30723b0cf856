"""Runs with given settings and metrics, without recordings."""

from pathlib import Path
from typing import Any

import yaml

from workbench.recording.read.reader import Run


def fake_run(
    prior: str = "walking",
    n: int = 500,
    seed: Any = 0,
    status: str = "complete",
    cost: dict[str, float] | None = None,
    study: bool = False,
    run_id: str = "",
    version: str = "1",
    motion: Any = None,
    **metrics: float,
) -> Run:
    """Return a run with these settings and metrics; its prior excludes the person of `motion`."""
    config: dict[str, Any] = {
        "prior": {"_target_": f"workbench.priors.{prior}"},
        "inference": {"n_particles": n},
        "seed": seed,
    }
    if motion is not None:
        config["dataset"] = {"motion": motion, "seed": seed}
        config["prior"]["exclude"] = [str(motion)[:2]]
    properties: dict[str, dict[str, Any]] = {
        "run": {"status": status, "id": run_id},
        "config": {"TextDocument:text": yaml.safe_dump(config)},
        "provenance": {"experiment": "custom", "workbench": version},
        "metrics": metrics,
        "cost": cost or {},
    }
    if not study:
        properties["body"] = {"joints": ["pelvis"], "pose": ["root_x"]}
    return Run(
        Path(f"{prior}_{n}_{seed}_{status}.rrd" if motion is None else f"{prior}_{motion}_{seed}.rrd"), properties, {}
    )
