"""What pytest gets from the workbench: an option for the contract tests, and a fixture for baselines of runs."""

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:  # imported late, as pytest loads this module in every project
    from workbench.recording.read.reader import Run
    from workbench.results.check.outcome import Check


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --component-package and --workbench-update."""
    parser.addoption(
        "--component-package", metavar="PACKAGE", help="test the components of this package against workbench.contracts"
    )
    parser.addoption("--workbench-update", action="store_true", help="write the baselines of workbench_check")


@pytest.fixture
def workbench_check(request: pytest.FixtureRequest) -> "Callable[..., Check]":
    """Return a function that compares a run with the test's baseline, baselines/MODULE/TEST.rrd next to the test.

    Its second argument, "" by default, is added to the name, for several runs in one test. The option
    --workbench-update writes missing and changed baselines; see `workbench.check`.
    """

    def check(run: "Run", name: str = "") -> "Check":
        __tracebackhide__ = True
        from workbench.api import check

        stem = "-".join(re.findall(r"[\w.]+", f"{request.node.name} {name}"))  # also of a parametrized test
        folder = request.path.parent / "baselines" / request.path.stem
        return check(run, folder / f"{stem}.rrd", update=request.config.getoption("--workbench-update"))

    return check
