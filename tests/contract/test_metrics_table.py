"""One table knows all metrics: every number that a run writes has a row in it, and every row a run that writes it."""

import ast
import re
import runpy
from dataclasses import replace
from pathlib import Path

import pytest
from recording_steps import BODY, steps

import workbench
from workbench.evaluation import metrics
from workbench.evaluation.errors.marker_offsets import MarkerOffsets
from workbench.evaluation.errors.pose_errors import step_errors
from workbench.evaluation.metrics import METRICS, row_of
from workbench.recording.read.reader import read

PACKAGE, ROOT = Path(workbench.__file__).parent, Path(__file__).parents[2]
PRODUCERS = ("evaluation/errors", "evaluation/uncertainty", "experiment", "inference", "likelihoods")


def strings(path):
    """Return the strings of a Python file without its docstrings; of an f-string the parts."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    constants = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in docstrings]
    return {node.value for node in constants if isinstance(node.value, str)}


def of_markers():
    """Return the names of a run whose truth is markers: joints without a pose."""
    offsets, names = MarkerOffsets(BODY.skeleton), set()
    for step in steps(20, n_particles=20):
        measured = replace(step, frame=replace(step.frame, truth=replace(step.frame.truth, pose=None)))
        names |= {*step_errors(measured, BODY), *offsets.add(measured)}
    return names | {*offsets.corrected_mm, *offsets.lengths_mm}


@pytest.fixture(scope="module")
def written():
    """The numbers of the baselines, one of nearly every kind of experiment, and of a run with markers, by name."""
    runs = [read(path) for path in (ROOT / "recordings" / "baselines").glob("*.rrd")]
    tracked = [run for run in runs if not run.is_study]
    return of_markers().union(*({*run.result, *run.metric_names, *run.properties.get("cost", {})} for run in tracked))


def test_every_number_of_a_run_has_a_row(written):
    assert {name for name in written if not row_of(name).meaning} == set()


def test_every_row_has_a_run_or_a_component_that_writes_it(written):
    named = set[str]().union(*(strings(path) for folder in PRODUCERS for path in (PACKAGE / folder).rglob("*.py")))
    unwritten = []
    for row in METRICS:
        member = re.compile(re.sub(r"<group>", "[a-z]+", re.sub(r"<(?!group)\w+>", r"\\w+", row.name)))
        is_written = any(member.fullmatch(name) for name in written) or not written.isdisjoint(row.run_names)
        if not is_written and row.name.partition("<")[0] not in named:
            unwritten.append(row.name)
    assert unwritten == []


def test_no_other_module_has_a_title_of_a_metric():
    titles = {text for row in METRICS for text in (row.title, row.heading) if " " in text}
    for path in PACKAGE.rglob("*.py"):
        if path != Path(metrics.__file__):
            assert not titles.intersection(strings(path)), path


def test_the_page_has_the_table():
    page = runpy.run_path(str(ROOT / "docs" / "metrics_tables.py"))
    text = page["PAGE"].read_text(encoding="utf-8")
    assert text == page["with_tables"](text), "run python docs/metrics_tables.py"
    for row in METRICS:
        assert f"| {row.title} |" in text
