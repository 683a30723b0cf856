"""Damaged C3D files, which ezc3d reads in the sandbox, because it loops or crashes on some."""

import pytest
from damage import changes, flips, refusal, withstands
from hypothesis import strategies as st
from valid_files import c3d, written

from workbench.motion.formats.markers import read_markers

pytest.importorskip("ezc3d")
words = st.lists(
    st.tuples(st.just("overwrite"), st.floats(0.0, 0.7), st.just(0.0),
              st.sampled_from([bytes(2), b"\x01\x00", b"\xff\xff", b"\xff\x7f", b"\x00\x80", b"\xff\x00"])),
    min_size=1, max_size=5,
)  # fmt: skip
"""Damage to words of the header and of the parameters, which hold lengths."""


@pytest.mark.slow
def test_random_damage_is_refused_or_read(tmp_path):
    withstands(read_markers, c3d(tmp_path / "a.c3d"), 30, changes | flips | words)


def test_a_header_with_more_frames_than_the_file_is_refused(tmp_path):
    content = bytearray(c3d(tmp_path / "a.c3d").read_bytes())
    content[2:4], content[6:10] = b"\xff\xff", b"\x01\x00\xff\xff"
    assert "expected at most" in refusal(read_markers, written(tmp_path / "a.c3d", bytes(content)))


@pytest.mark.parametrize("content", [b"", b"x" * 1000, b"\x02\x50"])
def test_another_format_is_refused(tmp_path, content):
    assert "expected a C3D file" in refusal(read_markers, written(tmp_path / "a.c3d", content))
