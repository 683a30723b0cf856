"""Comparison of two recordings: identical, equal to rounding, within tolerances, changed or missing numbers."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest
import recorded
from recording_steps import BODY, errors, steps, without_images
from rerun.chunk import RrdReader

from workbench.core.study import Bars, Curves, StudyResult
from workbench.recording.condense import condense
from workbench.recording.read.reader import read
from workbench.recording.study.study_recorder import record_study
from workbench.recording.write import file
from workbench.recording.write.file import RecordingFile
from workbench.results.check.agreement import Agreement, MetricChange, Tolerance, agreement
from workbench.results.check.compare import compare, demand_on, same_environment
from workbench.results.check.outcome import Check, exit_code, has_moved, moved, table
from workbench.results.check.seeds import compare_seeds

SAME = {"system": "Linux x86_64", "numpy": "1.0", "blas": "openblas 1 Haswell"}
OTHER = SAME | {"blas": "openblas 1 Zen"}
LOOSE = {"default": Tolerance(relative=0.05), "error_mm": Tolerance(absolute=3.0)}
RESULT = {"error_mm": 40.0, "frames": 4.0}


@pytest.fixture(scope="module")
def tracked():
    return without_images(steps(4, n_particles=30))


@pytest.fixture(scope="module")
def record(tmp_path_factory, tracked):
    """A function that records a run with changes and reads it."""
    folder, numbers = tmp_path_factory.mktemp("runs"), count()

    def record_run(run=tracked, result=RESULT, environment=SAME, metrics=errors, **provenance):
        path = folder / f"{next(numbers)}.rrd"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(file, "environment", lambda: environment)
            return read(recorded.record(path, run, metrics, result, provenance={"seed": 0, **provenance}))

    return record_run


@pytest.fixture(scope="module")
def original(record):
    return record()


def compared(was, now, tolerances=LOOSE, exact=False):
    return {finding.quantity: finding for finding in compare(was, now, demand_on(was, now, tolerances, exact))}


def failed(was, now, tolerances=LOOSE, exact=False):
    return {name: finding for name, finding in compared(was, now, tolerances, exact).items() if not finding.passed}


def with_pose(step, index, by):
    pose = step.expected_pose.copy()
    pose[index] += by
    return replace(step, expected_pose=pose)


def test_equal_runs_are_identical_in_every_number(record, original):
    repeated = record()
    assert same_environment(original, repeated)
    findings = compared(original, repeated)
    assert findings.keys() == {
        "error_mm", "error_relative_mm", "ess", "log_evidence", "visible_limbs", "frames",
        "frame numbers", "poses", "marginals",
    }  # fmt: skip
    assert all(finding.passed and finding.agreement is Agreement.IDENTICAL for finding in findings.values())


def test_the_first_difference_is_reported_with_frame_joint_and_size(record, original, tracked):
    knee = BODY.skeleton.dof("left_knee_flexion")
    moved = [*tracked[:2], *(with_pose(step, knee, 0.01) for step in tracked[2:])]
    failures = failed(original, record(moved))
    shank = 1e3 * 0.01 * BODY.shape.as_dict()["calf"]  # arc length, mm
    location, _, distance = failures["poses"].detail.rpartition(" by ")
    assert location == f"poses first differ in frame {tracked[2].frame.index}: left_ankle"
    assert float(distance.removesuffix(" mm")) == pytest.approx(shank, rel=0.01)
    assert f"first differs in frame {tracked[2].frame.index}: " in failures["error_mm"].detail


def test_a_difference_of_one_bit_is_rounding_and_fails_an_exact_comparison(record, original, tracked):
    index = 24
    step = tracked[3]
    bit = np.spacing(step.expected_pose[index])
    was, now = original, record([*tracked[:3], with_pose(step, index, bit)], metrics=lambda step: {})
    assert "poses" not in failed(was, now)
    assert compared(was, now)["poses"].agreement is Agreement.ROUNDING
    detail = failed(was, now, exact=True)["poses"].detail
    assert BODY.skeleton.dof_names[index] in detail
    assert f"frame {step.frame.index}" in detail


@pytest.mark.parametrize(
    ("was", "now", "class_"),
    [
        (2.0, 2.0, Agreement.IDENTICAL),
        (2.0, 2.0 + 1e-9, Agreement.ROUNDING),
        (2.0, 2.0 + 3e-9, Agreement.TOLERANCE),
        (104.0, 100.0, Agreement.TOLERANCE),
        (106.0, 100.0, Agreement.CHANGED),
        ([1e3, 1e-9], [1e3, 3e-9], Agreement.ROUNDING),  # near zero in a quantity of the order 1000
        ([1.0, np.nan, -np.inf], [1.0, np.nan, -np.inf], Agreement.IDENTICAL),
        ([1.0, np.nan], [np.nan, 1.0], Agreement.CHANGED),
        ([0.0, -np.inf], [0.0, -1.0], Agreement.CHANGED),
        (np.float32(3.0), np.nextafter(np.float32(3.0), np.float32(4.0)), Agreement.ROUNDING),
        (3, 4, Agreement.CHANGED),
        ("a", "a", Agreement.IDENTICAL),
        ([1.0, 2.0], [1.0], Agreement.CHANGED),
    ],
    ids=str,
)
def test_classes_of_agreement(was, now, class_):
    for pair in ((was, now), (now, was)):
        assert agreement(*pair, Tolerance(relative=0.05)) is class_
        assert agreement(*pair) is (Agreement.CHANGED if class_ is Agreement.TOLERANCE else class_)


def test_exchanged_weights_change_the_marginals_alone(record, original, tracked):
    swapped = tracked[1].log_weights.copy()
    swapped[[0, 1]] = swapped[[1, 0]]  # the effective sample size stays
    exchanged = record([tracked[0], replace(tracked[1], log_weights=swapped), *tracked[2:]])
    assert failed(original, exchanged).keys() == {"marginals"}


@pytest.mark.parametrize("environment", [OTHER, SAME | {"numpy": "2.0"}, {"system": "another"}])
def test_in_another_environment_results_may_change_within_their_tolerance(record, original, tracked, environment):
    moved = [with_pose(step, 0, 0.001) for step in tracked]
    assert failed(original, record(moved, RESULT | {"error_mm": 42.9}, environment)) == {}
    failures = failed(original, record(moved, RESULT | {"error_mm": 43.1}, environment))
    assert failures.keys() == {"error_mm"}
    assert failures["error_mm"].allowed == "± 3"
    assert failures["error_mm"].agreement is Agreement.CHANGED
    assert f"poses first differ in frame {tracked[0].frame.index}" in failures["error_mm"].detail


def without_error(step):
    """Return all errors of a step except error_mm."""
    return {name: value for name, value in errors(step).items() if name != "error_mm"}


@pytest.mark.parametrize("environment", [SAME, OTHER], ids=["same", "other"])
class TestEveryEnvironment:
    def test_a_missing_metric_fails_and_a_new_one_does_not(self, record, original, environment):
        result = {"frames": 4.0, "speed": 1.0}
        was, now = original, record(result=result, metrics=lambda step: {}, environment=environment)
        assert failed(was, now).keys() == {"error_mm", "error_relative_mm", "log_evidence"}
        assert failed(was, now)["error_mm"].detail == "missing"
        assert compared(was, now)["speed"].detail == "new"
        in_frames = record(environment=environment, metrics=without_error)
        assert failed(was, in_frames).keys() == {"error_mm"}

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_a_number_that_is_not_finite_fails(self, record, original, environment, value):
        result = RESULT | {"error_mm": value}
        assert "error_mm" in failed(original, record(result=result, environment=environment))
        assert "error_mm" in failed(record(result=result), record(result=result, environment=environment))

    def test_a_pose_that_is_not_finite_fails(self, record, original, tracked, environment):
        now = record(environment=environment)
        now.poses[1][3, 4] = np.nan
        assert failed(original, now)["poses"].detail == "not all numbers are finite"

    def test_a_missing_frame_is_named(self, record, original, tracked, environment):
        failures = failed(original, record([*tracked[:2], tracked[3]], environment=environment))
        assert failures["frame numbers"].detail == f"frame {tracked[2].frame.index} is missing, 1 in all"
        extra = failed(record([*tracked[:2], tracked[3]]), record(environment=environment))
        assert extra["frame numbers"].detail == f"frame {tracked[2].frame.index} is new, 1 in all"

    def test_a_run_that_is_not_complete_fails(self, record, tracked, environment):
        complete = record(environment=environment)
        properties = {**complete.properties, "run": {**complete.properties["run"], "status": "running"}}
        running = replace(complete, properties=properties)
        for was, now, which in ((complete, running, "the new run"), (running, complete, "the old run")):
            assert failed(was, now)["run"].detail == f"{which} is not complete (status: running)"


def study(path, curve, names=("a", "b"), metrics=None, settings=None):
    x = np.arange(4.0)
    figures = [Curves(names[0], x, {"knee": curve}, x_name="t", y_name="rad"), Bars(names[1], x, x**2, x_name="k")]
    labels = {"config_yaml": "seed: 1", "settings": settings or {}, "provenance": {"seed": 1}}
    with RecordingFile(path, run_id="s", **labels) as recorder:
        record_study(recorder, StudyResult(figures=tuple(figures), metrics=metrics or {"n": 3.0}, note="caption"))
    return read(path)


def test_studies_are_compared_by_metrics_and_figures(original, tmp_path):
    curve = np.array([1.0, 2.0, 3.0, np.nan])  # a gap in a curve is no difference
    was = study(tmp_path / "a.rrd", curve)
    assert failed(was, study(tmp_path / "b.rrd", curve)) == {}
    bit = study(tmp_path / "c.rrd", np.nextafter(curve, 9.0))
    assert failed(was, bit) == {}
    failures = failed(was, bit, exact=True)
    assert {name: finding.detail for name, finding in failures.items()} == {"figure a": "curves differs"}
    assert failed(was, study(tmp_path / "d.rrd", curve, names=("a", "c")))["figure b"].detail == "missing"
    assert "n" in failed(was, study(tmp_path / "e.rrd", curve, metrics={"n": 4.0}))
    assert failed(original, was).keys() == {"run"}


def test_seeds_are_compared_as_distributions_and_a_missing_number_fails(record):
    new = [record([], {"error_mm": value, "tracked": 1.0}) for value in (40.0, 44.0, 42.0, 41.0)]
    near = record([], {"error_mm": 45.0, "tracked": 1.0})
    far = record([], {"error_mm": 90.0, "tracked": 1.0, "removed": 2.0})
    assert [finding.passed for finding in compare_seeds([([near], new)])[0]] == [True, True]
    findings = {finding.quantity: finding for finding in compare_seeds([([far], new)])[0]}
    assert not findings["error_mm"].passed
    assert (findings["error_mm"].was, findings["error_mm"].now) == (90.0, 41.75)
    assert findings["removed"].detail == "missing from 4 of 5 runs"


def test_a_condensed_recording_has_all_numbers_and_no_images(record, tmp_path):
    run = record(list(steps(4, n_particles=30)))
    condense(run, tmp_path / "run.rrd")
    condensed = read(tmp_path / "run.rrd")
    assert condensed.properties == run.properties
    assert failed(run, condensed, exact=True) == failed(condensed, run, exact=True) == {}
    np.testing.assert_array_equal(condensed.joints.positions, run.joints.positions)
    np.testing.assert_array_equal(condensed.true_joints.positions, run.true_joints.positions)
    assert components(condensed.path).isdisjoint(
        {"EncodedImage:blob", "Ellipsoids3D:centers", "BarChart:values", "Draws:poses"}
    )
    assert components(condensed.path) < components(run.path)


def test_a_condensed_study_has_its_figures_without_drawings(tmp_path):
    original = study(tmp_path / "study.rrd", np.array([1.0, np.nan, 3.0, 4.0]), settings={"seed": 1})
    condense(original, tmp_path / "condensed.rrd")
    condensed = read(tmp_path / "condensed.rrd")
    assert [figure.name for figure in condensed.figures] == ["a", "b"]
    assert original.properties["settings"] == {"seed": 1.0}
    assert (condensed.settings, "settings" in condensed.properties) == ({"seed": 1}, False)
    assert failed(original, condensed, exact=True) == {}
    assert condensed.note == "caption"
    assert "EncodedImage:blob" in components(original.path) - components(condensed.path)


def components(path):
    return {name for chunk in RrdReader(path).stream() for name in chunk.to_record_batch().schema.names if ":" in name}


def finding(agreement, was=1.0, now=1.0, passed=True):
    return MetricChange("mpjpe_abs_mm", was, now, "rounding", passed, "", agreement)


def test_a_passed_recording_is_a_row_with_its_numbers_by_class():
    check = Check("walk.rrd", [finding(Agreement.IDENTICAL)] * 3 + [finding(Agreement.ROUNDING)])
    assert table([check]).splitlines()[1].endswith("ok 3 identical, 1 equal to rounding")
    assert exit_code([check]) == 0
    assert moved([check]) == "nothing moved"


def test_a_failed_number_is_printed_with_its_differing_digits():
    check = Check("walk.rrd", [finding(Agreement.CHANGED, 1.0, 1.0 + 1e-8, passed=False)])
    row = table([check]).splitlines()[1]
    assert "1.0000000099999999" in row
    assert "FAILED (changed)" in row
    assert exit_code([check]) == 1


def test_numbers_move_within_tolerance_but_not_by_rounding():
    assert [has_moved(finding(agreement)) for agreement in (*Agreement, None)] == [False, False, True, True, True]
