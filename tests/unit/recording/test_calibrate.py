"""Tolerances that are measured."""

from types import SimpleNamespace

import numpy as np
import yaml

from workbench.recording.compare.calibrate import as_yaml, measured


def runs(**numbers):
    """Pairs of runs from arrays (n, 2) of each number."""
    n = len(next(iter(numbers.values())))
    made = [[SimpleNamespace(result={name: float(x[k, side]) for name, x in numbers.items()}) for side in (0, 1)]
            for k in range(n)]  # fmt: skip
    return [tuple(pair) for pair in made]


def test_the_next_run_passes_as_often_as_is_said():
    """In all three numbers, of which one hangs together with another."""
    rng = np.random.default_rng(0)
    passed = 0
    for _ in range(1000):
        a, b = rng.standard_normal((2, 6))
        moved = np.stack([a, a + 0.1 * b, 3.0 * b])
        was = np.array([40.0, 5.0, 100.0])[:, None]
        pairs = np.stack(np.broadcast_arrays(was, was + moved), axis=-1)
        found = measured(runs(**{name: pairs[k, :5] for k, name in enumerate("abc")}))
        passed += all(abs(moved[k, 5]) <= found[name].absolute for k, name in enumerate("abc"))
    assert 0.95 - 3 * np.sqrt(0.05 * 0.95 / 1000) <= passed / 1000 <= 0.995


def test_what_rounding_moves_is_exact_and_what_is_missing_is_left_out():
    still, moved = np.full((3, 2), 7.0), np.array([[1.0, 1.5], [2.0, 2.0], [3.0, 2.75]])
    pairs = runs(still=still * [1.0, 1.0 + 1e-13], moved=moved, gone=still)
    del pairs[1][1].result["gone"]
    found = measured(pairs)
    assert found.keys() == {"moved", "still"}
    assert found["still"].absolute == 0.0
    assert found["moved"].absolute >= 0.5
    kept = yaml.safe_load(as_yaml(found))["check"]
    assert kept == {"default": {"absolute": 0.0, "relative": 1e-9},
                    "moved": {"absolute": found["moved"].absolute, "relative": 0.0}}  # fmt: skip
