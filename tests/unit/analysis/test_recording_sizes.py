"""Sizes of a recording's frames by path."""

from pathlib import Path

import pytest

import workbench as wb
from analysis.recording_sizes import FILE, main, sizes, table

BASELINE = Path(__file__).parents[3] / "recordings" / "baselines" / "walk_straight.rrd"


def test_sizes_are_per_frame():
    n_frames = len(wb.read(BASELINE).poses[0])
    assert sizes(BASELINE)[FILE] == pytest.approx(1e-3 * BASELINE.stat().st_size / n_frames)


def test_the_command_writes_the_table_and_rejects_a_missing_recording(tmp_path):
    file = tmp_path / "table.md"
    assert main([f"walk={BASELINE}", "-o", str(file)]) == 0
    assert file.read_text(encoding="utf-8") == table({"walk": sizes(BASELINE)})
    study = BASELINE.with_name("period_snr.rrd")
    for recording in (f"walk={tmp_path / 'missing.rrd'}", f"study={study}", str(BASELINE)):
        assert main([recording]) == 2
