"""What a check prints: every number's class, and what it could not see."""

from types import SimpleNamespace

from workbench.results.check.agreement import Agreement, Demand, MetricChange, Tolerance
from workbench.results.check.outcome import Check, exit_code, has_moved, moved, notes, table


def run(environment, **result):
    return SimpleNamespace(environment=environment, result=result)


def finding(agreement, was=1.0, now=1.0, passed=True):
    return MetricChange("error_abs_mm", was, now, "rounding", passed, "", agreement)


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


def test_in_another_environment_the_difference_and_what_cannot_be_seen_are_stated():
    tolerances = {"error_abs_mm": Tolerance(absolute=4.0), "default": Tolerance()}
    demand = Demand(Agreement.TOLERANCE, tolerances)
    runs = {"was": run({"numpy": "2.0"}, error_abs_mm=50.0), "now": run({"numpy": "2.4"}, error_abs_mm=51.0)}
    here = Demand(Agreement.ROUNDING, tolerances)
    first, second, third = notes([Check("a", demand=demand, **runs), Check("b", demand=here, **runs)])
    assert first.startswith("1 of 2 were recorded in another environment: numpy 2.0 → 2.4")
    assert "error_abs_mm by up to 8 % in half of them, 8 % in all" in second
    assert "--against" in third
    assert notes([Check("b", demand=here, **runs)]) == []
