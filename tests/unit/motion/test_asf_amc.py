"""Joint positions against 4×4 matrices computed here, straight from the text of the files."""

import pytest
import sound_files

from workbench.motion.formats.asf_amc import read_amc
from workbench.utils.errors import InputError

ASF = """:units
  length 0.5
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    name thigh
    direction 0 -1 0
    length 10
    axis 0 0 90 XYZ
    dof rx
  end
  begin
    name shin
    direction 0 -1 0
    length 5
    axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""


def test_another_skeleton_may_be_named(tmp_path):
    (tmp_path / "5.asf").write_text(sound_files.ASF)
    (tmp_path / "5_01.amc").write_text(sound_files.AMC)
    clip = read_amc(tmp_path / "5_01.amc")
    assert (len(clip), clip.first_frame) == (2, 5)
    (tmp_path / "elsewhere.asf").write_text(sound_files.ASF.replace("length 7", "length 14"))
    longer = read_amc(tmp_path / "5_01.amc", asf=tmp_path / "elsewhere.asf")
    assert longer.offsets == pytest.approx(2 * clip.offsets)
    with pytest.raises(InputError, match="expected a rate of"):
        read_amc(tmp_path / "5_01.amc", rate_hz=0.0)
