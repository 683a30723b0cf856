"""Two recordings compared: to rounding, by tolerances, and what is missing."""

from dataclasses import replace

import numpy as np
import pytest
from recording_steps import BODY, SPACE, errors, steps
from rerun.chunk import RrdReader

from workbench.core.study import Bars, Curves, StudyResult
from workbench.recording.condense import condense
from workbench.recording.read.reader import read
from workbench.recording.study.study_recorder import record_study
from workbench.recording.write import file
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.recorder import Recorder
from workbench.results.check.agreement import Agreement, MetricChange, Tolerance, agreement
from workbench.results.check.compare import compare, demand_on, same_environment
from workbench.results.check.outcome import Check, exit_code, has_moved, moved, table
from workbench.results.check.seeds import compare_seeds

HERE = {"system": "Linux x86_64", "numpy": "1.0", "blas": "openblas 1 Haswell"}
ELSEWHERE = HERE | {"blas": "openblas 1 Zen"}
LOOSE = {"default": Tolerance(relative=0.05), "error_mm": Tolerance(absolute=3.0)}
RESULT = {"error_mm": 40.0, "frames": 4.0}


@pytest.fixture(scope="module")
def tracked():
    return list(steps(4, n_particles=30))


@pytest.fixture
def made(tmp_path, tracked, monkeypatch):
    """Record a run, changed as asked, and read it."""
    paths = (tmp_path / f"{k}.rrd" for k in range(10))

    def make(run=tracked, result=RESULT, environment=HERE, measured=errors, **provenance):
        path = next(paths)
        labels = {"config_yaml": "", "provenance": {"seed": 0, **provenance}}
        monkeypatch.setattr(file, "environment", lambda: environment)
        with Recorder(path, BODY, SPACE, run_id=path.name, **labels) as recording:
            for step in run:
                recording.log(step, measured(step))
            recording.set_result(result)
        return read(path)

    return make


def compared(was, now, tolerances=LOOSE, exact=False):
    return {finding.quantity: finding for finding in compare(was, now, demand_on(was, now, tolerances, exact))}


def failed(was, now, tolerances=LOOSE, exact=False):
    return {name: finding for name, finding in compared(was, now, tolerances, exact).items() if not finding.passed}


def with_pose(step, index, by):
    pose = step.expected_pose.copy()
    pose[index] += by
    return replace(step, expected_pose=pose)


def test_equal_runs_are_equal_in_every_number(made):
    was, now = made(), made()
    assert same_environment(was, now)
    findings = compared(was, now)
    assert findings.keys() == {
        "error_mm", "error_relative_mm", "ess", "log_evidence", "visible_limbs", "frames",
        "frame numbers", "poses", "marginals",
    }  # fmt: skip
    assert all(finding.passed and finding.agreement is Agreement.IDENTICAL for finding in findings.values())


def test_the_first_frame_and_joint_that_differ_are_named_with_by_how_much(made, tracked):
    knee = BODY.skeleton.dof("left_knee_flexion")
    moved = [*tracked[:2], *(with_pose(step, knee, 0.01) for step in tracked[2:])]
    found = failed(made(), made(moved))
    shank = 1e3 * 0.01 * BODY.shape.as_dict()["calf"]  # an arc, in mm
    place, _, distance = found["poses"].detail.rpartition(" by ")
    assert place == f"poses first differ in frame {tracked[2].frame.index}: left_ankle"
    assert float(distance.removesuffix(" mm")) == pytest.approx(shank, rel=0.01)
    assert f"first differs in frame {tracked[2].frame.index}: " in found["error_mm"].detail


def test_the_last_bit_is_rounding_and_fails_where_identical_numbers_are_asked_for(made, tracked):
    index = 24
    step = tracked[3]
    bit = np.spacing(step.expected_pose[index])
    was, now = made(), made([*tracked[:3], with_pose(step, index, bit)], measured=lambda step: {})
    assert "poses" not in failed(was, now)
    assert compared(was, now)["poses"].agreement is Agreement.ROUNDING
    found = failed(was, now, exact=True)["poses"]
    assert BODY.skeleton.dof_names[index] in found.detail
    assert f"frame {step.frame.index}" in found.detail


@pytest.mark.parametrize(
    ("was", "now", "class_"),
    [
        (2.0, 2.0, Agreement.IDENTICAL),
        (2.0, 2.0 + 1e-9, Agreement.ROUNDING),
        (2.0, 2.0 + 3e-9, Agreement.TOLERANCE),
        (104.0, 100.0, Agreement.TOLERANCE),
        (106.0, 100.0, Agreement.CHANGED),
        ([1e3, 1e-9], [1e3, 3e-9], Agreement.ROUNDING),  # near zero in a quantity that is a thousand elsewhere
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


def test_weights_that_move_show_in_the_marginals(made, tracked):
    swapped = tracked[1].log_weights.copy()
    swapped[[0, 1]] = swapped[[1, 0]]  # the effective sample size stays
    assert set(failed(made(), made([tracked[0], replace(tracked[1], log_weights=swapped), *tracked[2:]]))) == {
        "marginals"
    }


def test_a_run_that_goes_on_from_a_frame_is_compared_from_there_on(made, tracked):
    """Its own numbers are of other frames."""
    frame = tracked[1].frame.index
    whole, part = made(), made(tracked[1:], RESULT | {"error_mm": 50.0}, parent_frame=frame)
    for was, now in ((whole, part), (part, whole)):
        findings = compared(was, now)
        assert findings.keys() == {
            "error_mm", "error_relative_mm", "ess", "log_evidence", "visible_limbs", "frame numbers", "poses",
        }  # fmt: skip
        assert all(finding.passed and finding.agreement is Agreement.IDENTICAL for finding in findings.values())
    assert (findings["frame numbers"].was, findings["frame numbers"].now) == (3, 3)
    assert failed(whole, made(tracked[1:], RESULT)).keys() >= {"frame numbers", "marginals"}

    other = [tracked[1], with_pose(tracked[2], 0, 0.1), tracked[3]]
    found = failed(whole, made(other, RESULT, parent_frame=frame))
    assert found["error_mm"].detail.startswith(f"first differs in frame {tracked[2].frame.index}: ")
    assert "poses" in found
    assert failed(whole, made(tracked[1:3], RESULT, parent_frame=frame))["frame numbers"].now == 2


@pytest.mark.parametrize("environment", [ELSEWHERE, HERE | {"numpy": "2.0"}, {"system": "another"}])
def test_elsewhere_results_may_move_by_their_tolerance(made, tracked, environment):
    was = made()
    moved = [with_pose(step, 0, 0.001) for step in tracked]
    assert failed(was, made(moved, RESULT | {"error_mm": 42.9}, environment)) == {}
    found = failed(was, made(moved, RESULT | {"error_mm": 43.1}, environment))
    assert found.keys() == {"error_mm"}
    assert found["error_mm"].allowed == "± 3"
    assert found["error_mm"].agreement is Agreement.CHANGED
    assert f"poses first differ in frame {tracked[0].frame.index}" in found["error_mm"].detail


def without_error(step):
    """All errors of a step but error_mm."""
    return {name: value for name, value in errors(step).items() if name != "error_mm"}


@pytest.mark.parametrize("environment", [HERE, ELSEWHERE], ids=["here", "elsewhere"])
class TestAlways:
    def test_a_metric_that_is_missing_fails_and_a_new_one_does_not(self, made, environment):
        was, now = made(), made(result={"frames": 4.0, "pace": 1.0}, measured=lambda step: {}, environment=environment)
        assert failed(was, now).keys() == {"error_mm", "error_relative_mm", "log_evidence"}
        assert failed(was, now)["error_mm"].detail == "missing"
        assert compared(was, now)["pace"].detail == "new"
        in_frames = made(environment=environment, measured=without_error)
        assert failed(was, in_frames).keys() == {"error_mm"}

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_a_number_that_is_not_finite_fails_even_where_it_was_none_before(self, made, environment, value):
        odd = RESULT | {"error_mm": value}
        assert "error_mm" in failed(made(), made(result=odd, environment=environment))
        assert "error_mm" in failed(made(result=odd), made(result=odd, environment=environment))

    def test_a_pose_that_is_not_finite_fails(self, made, tracked, environment):
        now = made(environment=environment)
        now.poses[1][3, 4] = np.nan
        assert failed(made(), now)["poses"].detail == "not all numbers are finite"

    def test_a_missing_frame_is_named(self, made, tracked, environment):
        found = failed(made(), made([*tracked[:2], tracked[3]], environment=environment))
        assert found["frame numbers"].detail == f"frame {tracked[2].frame.index} is missing, 1 in all"
        extra = failed(made([*tracked[:2], tracked[3]]), made(environment=environment))
        assert extra["frame numbers"].detail == f"frame {tracked[2].frame.index} is new, 1 in all"

    def test_a_run_that_is_not_complete_fails(self, made, tracked, environment):
        whole = made(environment=environment)
        cut = replace(whole, properties={**whole.properties, "run": {**whole.properties["run"], "status": "running"}})
        for was, now, which in ((whole, cut, "the new run"), (cut, whole, "the old run")):
            assert failed(was, now)["run"].detail == f"{which} is not complete (status: running)"


def study(path, curve, names=("a", "b"), metrics=None, settings=None):
    x = np.arange(4.0)
    figures = [Curves(names[0], x, {"knee": curve}, x_name="t", y_name="rad"), Bars(names[1], x, x**2, x_name="k")]
    labels = {"config_yaml": "seed: 1", "settings": settings or {}, "provenance": {"seed": 1}}
    with RecordingFile(path, run_id="s", **labels) as recorder:
        record_study(recorder, StudyResult(figures=tuple(figures), metrics=metrics or {"n": 3.0}, note="what it shows"))
    return read(path)


def test_studies_are_compared_by_metrics_and_figures(made, tmp_path):
    curve = np.array([1.0, 2.0, 3.0, np.nan])  # a gap in a curve is no failure
    was = study(tmp_path / "a.rrd", curve)
    assert failed(was, study(tmp_path / "b.rrd", curve)) == {}
    bit = study(tmp_path / "c.rrd", np.nextafter(curve, 9.0))
    assert failed(was, bit) == {}
    assert {name: each.detail for name, each in failed(was, bit, exact=True).items()} == {"figure a": "curves differs"}
    assert failed(was, study(tmp_path / "d.rrd", curve, names=("a", "c")))["figure b"].detail == "missing"
    assert "n" in failed(was, study(tmp_path / "e.rrd", curve, metrics={"n": 4.0}))
    assert failed(made(), was).keys() == {"run"}


def test_seeds_are_judged_as_distributions_and_a_missing_number_fails(made):
    new = [made([], {"error_mm": value, "tracked": 1.0}) for value in (40.0, 44.0, 42.0, 41.0)]
    near, far = made([], {"error_mm": 45.0, "tracked": 1.0}), made([], {"error_mm": 90.0, "tracked": 1.0, "gone": 2.0})
    assert [finding.passed for finding in compare_seeds([([near], new)])[0]] == [True, True]
    found = {finding.quantity: finding for finding in compare_seeds([([far], new)])[0]}
    assert not found["error_mm"].passed
    assert (found["error_mm"].was, found["error_mm"].now) == (90.0, 41.75)
    assert found["gone"].detail == "missing from 4 of 5 runs"


def test_a_condensed_recording_keeps_every_number_and_no_picture(made, tmp_path):
    run = made()
    condense(run, tmp_path / "run.rrd")
    kept = read(tmp_path / "run.rrd")
    assert kept.properties == run.properties
    assert failed(run, kept, exact=True) == failed(kept, run, exact=True) == {}
    np.testing.assert_array_equal(kept.joints.positions, run.joints.positions)
    np.testing.assert_array_equal(kept.true_joints.positions, run.true_joints.positions)
    assert components(kept.path).isdisjoint({"EncodedImage:blob", "Ellipsoids3D:centers", "BarChart:values"})
    assert components(kept.path) < components(run.path)


def test_a_condensed_study_keeps_its_figures_without_drawings(tmp_path):
    whole = study(tmp_path / "study.rrd", np.array([1.0, np.nan, 3.0, 4.0]), settings={"seed": 1})
    condense(whole, tmp_path / "kept.rrd")
    kept = read(tmp_path / "kept.rrd")
    assert [figure.name for figure in kept.figures] == ["a", "b"]
    assert whole.properties["settings"] == {"seed": 1.0}
    assert (kept.settings, "settings" in kept.properties) == ({"seed": 1}, False)
    assert failed(whole, kept, exact=True) == {}
    assert kept.note == "what it shows"
    assert "EncodedImage:blob" in components(whole.path) - components(kept.path)


def components(path):
    return {name for chunk in RrdReader(path).stream() for name in chunk.to_record_batch().schema.names if ":" in name}


def finding(agreement, was=1.0, now=1.0, passed=True):
    return MetricChange("mpjpe_abs_mm", was, now, "rounding", passed, "", agreement)


def test_a_passed_recording_counts_its_numbers_by_class():
    check = Check("walk.rrd", [finding(Agreement.IDENTICAL)] * 3 + [finding(Agreement.ROUNDING)])
    assert table([check]).splitlines()[1].endswith("ok 3 identical, 1 equal to rounding")
    assert exit_code([check]) == 0
    assert moved([check]) == "nothing moved"


def test_a_failed_number_is_printed_with_digits_that_differ():
    check = Check("walk.rrd", [finding(Agreement.CHANGED, 1.0, 1.0 + 1e-8, passed=False)])
    row = table([check]).splitlines()[1]
    assert "1.0000000099999999" in row
    assert "FAILED (changed)" in row
    assert exit_code([check]) == 1


def test_a_number_within_tolerance_or_new_has_moved_and_rounding_has_not():
    assert [has_moved(finding(agreement)) for agreement in (*Agreement, None)] == [False, False, True, True, True]
