"""Synthetic run folders, each with a summary.json."""

import json
from itertools import product

from workbench.recording.format import FORMAT


def summary(prior="smooth", n=500, seed=0, status="complete", error=40.0, day=1, **other):
    """Return the contents of a run's summary.json."""
    return {
        "format": FORMAT, "status": status, "experiment": "walk_straight", "seed": seed,
        "metrics": {"mpjpe_abs_mm": error, "coverage_90": 0.9, "log_evidence": None},
        "provenance": {"commit": "c" * 40, "changed": "no", "choices": [f"prior={prior}", "body=dataset"]},
        "settings": {
            "seed": seed, "prior": {"_target_": f"workbench.priors.{prior}"}, "inference": {"n_particles": n},
            "likelihood": {"weights": {"edges": 0.5}}, "recorder": {"stream": False},
        },
        "identity": f"{prior}-{n}-{seed}", "started": f"202611{day:02d}T150000.123456Z", "host": "elsewhere",
        "error": None, **other,
    }  # fmt: skip


def write_run(folder, **fields):
    """Write a run folder without a recording and return it."""
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text(json.dumps(summary(**fields)))
    return folder


def write_sweep(folder, priors=("smooth", "walking"), ns=(100, 400), seeds=(0, 1, 2)):
    """Write the run folders of a sweep and return it; job k has an error of 10 + k mm."""
    for k, (prior, n, seed) in enumerate(product(priors, ns, seeds)):
        write_run(folder / str(k), prior=prior, n=n, seed=seed, error=10.0 + k, day=1 + k)
    return folder
