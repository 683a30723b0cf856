"""TRC files: random damage, rates that no camera has, and headers that promise more than there is."""

import pytest
from damage import refusal, withstands
from sound_files import TRC, written

from workbench.motion.formats.markers import read_markers
from workbench.utils.input_limits import MOST_JOINTS, MOST_NUMBERS


def test_random_damage(tmp_path):
    withstands(read_markers, written(tmp_path / "a.trc", TRC), 200)


@pytest.mark.parametrize("rate", ["0", "-30", "nan", "inf", "1e300", "0.01"])
def test_rates(tmp_path, rate):
    assert "found" in refusal(read_markers, written(tmp_path / "a.trc", TRC.replace("60\t60", f"{rate}\t60")))


def test_more_markers_and_coordinates_than_memory_holds(tmp_path):
    lines = TRC.split("\n")
    lines[3] = "Frame#\tTime\t" + "\t".join(f"m{k}\t\t" for k in range(MOST_JOINTS + 1))
    assert "markers" in refusal(read_markers, written(tmp_path / "a.trc", "\n".join(lines)))
    lines[3] = "Frame#\tTime\t" + "\t".join(f"m{k}\t\t" for k in range(MOST_JOINTS))
    content = "\n".join(
        [*lines, *["1\t0"] * (MOST_NUMBERS // 3 // MOST_JOINTS + 1)]
    )  # cells left out at the line's end
    assert "coordinates" in refusal(read_markers, written(tmp_path / "b.trc", content))
