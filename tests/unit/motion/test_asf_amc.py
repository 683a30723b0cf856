"""Joint positions against 4×4 matrices computed here, straight from the text of the files."""

import numpy as np
import pytest
import sound_files

from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.utils.errors import InputError

BVH = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT arm
  {
    OFFSET 0 100 0
    CHANNELS 3 Xrotation Zrotation Yrotation
    End Site
    {
      OFFSET 50 20 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
100 200 300 0 0 0 0 0 0
100 200 300 0 0 90 90 90 0
"""


def test_bvh_by_hand(tmp_path):
    (tmp_path / "arm.bvh").write_text(BVH)
    clip = read_bvh(tmp_path / "arm.bvh")
    assert clip.joints == ("hips", "arm", "arm_end")
    assert clip.parents.tolist() == [-1, 0, 1]
    # at rest the file's (1, 2, 3), (1, 3, 3), (1.5, 3.2, 3) m; the file's y is the world's up
    np.testing.assert_allclose(clip.positions[0], [[3, 1, 2], [3, 1, 3], [3, 1.5, 3.2]], atol=1e-12)
    # the hand is at (0.5, 0.2, 0): Z takes x to y and y to -x, X then y to z, the hips' turn about y at last z to x
    # and -x to z: from the arm's place it lies at (0.5, 0, 0.2) of the file
    np.testing.assert_allclose(clip.positions[1], [[3, 1, 2], [3, 1, 3], [3.2, 1.5, 3]], atol=1e-12)


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


def test_acclaim_by_hand(tmp_path):
    (tmp_path / "s.asf").write_text(ASF)
    (tmp_path / "s_1.amc").write_text(":DEGREES\n7\nroot 0 20 0 0 0 0\nthigh 90\n8\nroot 0 20 0 0 90 0\nthigh 0\n")
    clip = read_amc(tmp_path / "s_1.amc")
    assert (clip.joints, clip.first_frame) == (("root", "thigh", "shin", "shin_end"), 7)
    unit = 0.0254 / 0.5
    # the thigh's x axis is turned to the file's y, so its 90 degrees twist the leg and move nothing
    expected = np.array([[0, 0, 20], [0, 0, 20], [0, 0, 10], [0, 0, 5]]) * unit
    np.testing.assert_allclose(clip.positions[0], expected, atol=1e-12)
    np.testing.assert_allclose(clip.positions[1], expected, atol=1e-12)
    # 90 degrees about the file's y (the world's z) take the file's z (world x) to its x (world y), in either frame
    for frame, joint in ((0, "thigh"), (1, "root")):
        np.testing.assert_allclose(clip.orientations[frame, clip.joint(joint), :, 0], [0, 1, 0], atol=1e-12)


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
