"""What a check prints: every number's class, and what it could not see."""

from workbench.results.check.agreement import Agreement, MetricChange
from workbench.results.check.outcome import Check, exit_code, has_moved, moved, table


def finding(agreement, was=1.0, now=1.0, passed=True):
    return MetricChange("error_abs_mm", was, now, "rounding", passed, "", agreement)


def test_a_passed_recording_counts_its_numbers_by_class():
    check = Check("walk.rrd", [finding(Agreement.IDENTICAL)] * 3 + [finding(Agreement.ROUNDING)])
    assert table([check]).splitlines()[1].endswith("ok 3 identical, 1 equal to rounding")
    assert exit_code([check]) == 0
    assert check.unmoved
    assert moved([check]) == "nothing moved"


def test_a_failed_number_is_printed_with_digits_that_differ():
    check = Check("walk.rrd", [finding(Agreement.CHANGED, 1.0, 1.0 + 1e-8, passed=False)])
    row = table([check]).splitlines()[1]
    assert "1.0000000099999999" in row
    assert "FAILED (changed)" in row
    assert exit_code([check]) == 1


def test_a_number_within_tolerance_or_new_has_moved_and_rounding_has_not():
    assert [has_moved(finding(agreement)) for agreement in (*Agreement, None)] == [False, False, True, True, True]
