"""TRC files of other programs: separators, times, and missing rows and cells."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from workbench.motion.formats.trc import read_trc
from workbench.utils.errors import InputError

QUICK = settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
NAMES = ("LShoulder", "LKnee")


def positions(n):
    return np.round(np.random.default_rng(0).uniform(0.1, 1.5, (n, 2, 3)), 4)


def trc(points, frames, times, rate="30", names=NAMES, sep="\t", mark=".", digits=6):
    """Return a TRC file of positions in metres, in the file's axes."""
    columns = [cell for name in names for cell in (name, *([] if sep == " " else ["", ""]))]
    axes = [*([] if sep == " " else ["", ""]), *[f"{axis}{k}" for k in (1, 2) for axis in "XYZ"]]
    lines = [sep.join(["PathFileType", "4", "(X/Y/Z)", "a.trc"]),
             sep.join(["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"]),
             sep.join([rate, rate, str(len(points)), "2", "m"]).replace(".", mark),
             sep.join(["Frame#", "Time", *columns]), sep.join(axes), ""]  # fmt: skip
    for frame, time, row in zip(frames, times, points.reshape(len(points), -1), strict=True):
        cells = [str(frame), f"{time:.{digits}f}", *["" if np.isnan(x) else f"{x:.4f}" for x in row]]
        lines.append(sep.join(cells).replace(".", mark))
    return "\n".join([*lines, ""])


def read(folder, text, encoding="utf-8"):
    (folder / "a.trc").write_bytes(text.encode(encoding))
    return read_trc(folder / "a.trc")


@QUICK
@given(
    form=st.sampled_from([("\t", "."), ("\t", ","), (";", ","), (",", "."), (" ", "."), (" ", ",")]),
    newline=st.sampled_from(["\n", "\r\n", "\r"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    blank=st.booleans(),
)
def test_separators_marks_and_encodings_are_recognized(tmp_path, form, newline, encoding, blank):
    points = positions(5)
    text = trc(points, range(1, 6), np.arange(5) / 30, names=("Müller:LShoulder", "LKnee"), sep=form[0], mark=form[1])
    text = text.replace("\n", "\n\n") if blank else text
    raw = read(tmp_path, text.replace("\n", newline), encoding)
    assert (raw.names, raw.rate_hz, raw.unit) == (["Müller:LShoulder", "LKnee"], 30.0, "m")
    np.testing.assert_array_equal(raw.positions, points)


@QUICK
@given(
    present=st.sets(st.integers(0, 29), min_size=3).map(sorted),
    rate=st.sampled_from([30.0, 60.0, 100.0, 119.88]),
    digits=st.integers(3, 9),
    start=st.sampled_from([0.0, 4.25]),
    header=st.sampled_from(["right", "wrong", "missing"]),
)
def test_rows_are_placed_by_their_times(tmp_path, present, rate, digits, start, header):
    """DataRate can be wrong if most rows are adjacent in time."""
    points, frames = positions(30), np.array(present)
    steps = np.diff(frames)
    if header != "right" and np.median(steps) != 1.0:
        frames, steps = np.arange(30), np.ones(29)
    written = {"right": f"{rate:g}", "wrong": f"{2 * rate:g}", "missing": ""}[header]
    raw = read(tmp_path, trc(points[frames], frames + 1, start + frames / rate, written, digits=max(digits, 5)))
    assert raw.rate_hz == pytest.approx(rate, rel=1e-3)
    expected = np.full((frames[-1] - frames[0] + 1, 2, 3), np.nan)
    expected[frames - frames[0]] = points[frames]
    np.testing.assert_array_equal(raw.positions, expected)


def test_frame_numbers_replace_invalid_times(tmp_path, caplog):
    points = positions(4)
    raw = read(tmp_path, trc(points, [1, 2, 5, 6], np.zeros(4)))
    assert len(raw.positions) == 6
    assert np.isnan(raw.positions[2:4]).all()
    assert "the times do not increase" in caplog.text
    raw = read(tmp_path, trc(points, [1, 2, 3, 4], 1000.0 * np.arange(4) / 30, digits=3))
    assert raw.rate_hz == 30.0
    assert "read in milliseconds" in caplog.text
    with pytest.raises(InputError, match="a DataRate, or times that increase"):
        read(tmp_path, trc(points, [1, 2, 3, 4], np.zeros(4), rate=""))


def test_unequal_times_are_interpolated(tmp_path, caplog):
    times = np.array([0.0, 0.1, 0.25, 0.3, 0.4, 0.5, 0.6])
    points = np.broadcast_to(times[:, None, None] + 1.0, (7, 2, 3))
    raw = read(tmp_path, trc(points, range(1, 8), times, rate=""))
    assert "rows at unequal times" in caplog.text
    grid = np.arange(len(raw.positions)) / raw.rate_hz
    present = np.isfinite(raw.positions[:, 0, 0])
    assert present.sum() >= 5
    np.testing.assert_allclose(raw.positions[present, 0, 0], grid[present] + 1.0, atol=0.002)


def test_missing_cells_are_gaps(tmp_path):
    points = positions(3)
    text = trc(points, range(1, 4), np.arange(3) / 30)
    lines = text.split("\n")
    row = lines[7].split("\t")
    for cells in (["", "", ""], ["nan", "NaN", "-nan(ind)"], ["null", "None", "-"]):
        lines[7] = "\t".join([*row[:2], *cells, *row[5:]])
        raw = read(tmp_path, "\n".join(lines))
        assert np.isnan(raw.positions[1, 0]).all()
        np.testing.assert_array_equal(raw.positions[:, 1], points[:, 1])


def test_repeated_names_and_a_late_first_frame_are_reported(tmp_path, caplog):
    raw = read(tmp_path, trc(positions(2), [12, 13], [0.4, 0.4333], names=("LKnee", "LKnee"), digits=4))
    assert len(raw.positions) == 2
    assert "several markers are called LKnee" in caplog.text
    assert "the first row is frame 12 at 0.4 s" in caplog.text


def test_lines_may_be_separated_by_blanks_alone(tmp_path):
    points = positions(4)
    text = trc(points, range(1, 5), np.arange(4) / 30)
    head, rows = text[: text.index("\n\n1\t")], text[text.index("\n\n1\t") :]
    for other in (head + rows.replace("\t", "  "), text.replace("30\t30\t4\t2\tm", "30 30 4 2 m"),
                  text.replace("30\t30\t4\t2\tm", "30\t\t30\t4\t\t2\tm")):  # fmt: skip
        raw = read(tmp_path, other)
        np.testing.assert_array_equal(raw.positions, points)
        assert (raw.rate_hz, raw.unit) == (30.0, "m")
    with pytest.raises(InputError, match=r"line 10: expected 6 coordinates, found 5; blanks leave no place for gaps"):
        read(tmp_path, head + rows.replace("\t", " ").rstrip()[:-7])


@pytest.mark.parametrize(("announced", "is_said"), [(4, False), (6, False), (5, True), (300, True)])
def test_a_header_with_another_number_of_frames_is_reported(tmp_path, caplog, announced, is_said):
    """Two of six frames are missing rows."""
    text = trc(positions(4), [1, 2, 5, 6], np.array([0, 1, 4, 5]) / 30)
    read(tmp_path, text.replace("30\t30\t4", f"30\t30\t{announced}"))
    assert (f"the header has {announced} frames, the file 4" in caplog.text) == is_said


@pytest.mark.parametrize("announced", ["300", "300.0"])
def test_a_count_of_frames_may_have_a_decimal_point(tmp_path, caplog, announced):
    text = trc(positions(4), range(1, 5), np.arange(4) / 30)
    read(tmp_path, text.replace("30\t30\t4", f"30\t30\t{announced}"))
    assert "300" in caplog.text


@pytest.mark.parametrize(("n_lost", "n_rows"), [(0, 4), (1, 4), (8, 3), (50, 3)])
def test_a_last_row_that_is_cut_off_is_left_out(tmp_path, caplog, n_lost, n_rows):
    """One character that is lost is the line's end."""
    points = positions(4)
    text = trc(points, range(1, 5), np.arange(4) / 30)
    raw = read(tmp_path, text[: len(text) - n_lost])
    np.testing.assert_array_equal(raw.positions, points[:n_rows])
    assert ("a.trc, line" in caplog.text) == (n_rows < 4)


@pytest.mark.parametrize("rate", ["0", "0.0", ""])
def test_a_rate_of_zero_is_none(tmp_path, rate):
    assert read(tmp_path, trc(positions(4), range(1, 5), np.arange(4) / 30, rate=rate)).rate_hz == 30.0


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: [lines[0], *[f"\t{line}" for line in lines[1:3]], *lines[3:]],
        lambda lines: [lines[0], lines[1].replace("\t", "\t\t"), *lines[2:]],
        lambda lines: ["\t".join(f'"{cell}"' for cell in line.split("\t")) if line else "" for line in lines],
    ],
)
def test_headers_with_other_separators_and_quotes_are_read(tmp_path, caplog, change):
    points = positions(4)
    raw = read(tmp_path, "\n".join(change(trc(points, range(1, 5), np.arange(4) / 30).strip().split("\n"))))
    np.testing.assert_array_equal(raw.positions, points)
    assert (raw.rate_hz, raw.unit, caplog.text) == (30.0, "m", "")
