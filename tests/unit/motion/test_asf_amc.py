"""Joint positions against 4×4 matrices computed here, straight from the text of the files."""

import re

import numpy as np
import pytest
import sound_files
from scipy.spatial.transform import Rotation

from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.utils.errors import InputError


def transform(rotation=None, translation=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if rotation is None else rotation.as_matrix()
    matrix[:3, 3] = translation
    return matrix


def world(point):
    """y up, facing z -> z up, facing x."""
    x, y, z = point
    return np.array([z, x, y])


def cmu_bone_ends(asf, amc, frame_number):
    """{bone: far end} in the world, m, of one frame of a CMU clip (degrees, axes and turns in the order x, y, z)."""
    metres = 0.0254 / 0.45
    bones = {}
    for block in re.findall(r"begin\s+id(.*?)\bend\b", asf.read_text(), re.S):
        words = dict(re.findall(r"^\s*(name|direction|length|axis|dof)[ \t]+(.*?)\s*$", block, re.M))
        bones[words["name"]] = words
    hierarchy = re.search(r":hierarchy\s+begin(.*)end", asf.read_text(), re.S)[1]
    children = {line.split()[0]: line.split()[1:] for line in hierarchy.split("\n") if line.strip()}
    frame = re.search(rf"^{frame_number}\s*$(.*?)(^\d+\s*$|\Z)", amc.read_text(), re.S | re.M)[1]
    values = {line.split()[0]: list(map(float, line.split()[1:])) for line in frame.split("\n") if line.strip()}

    root = values["root"]
    turned = transform(Rotation.from_euler("xyz", root[3:], degrees=True))
    matrices = {"root": transform(translation=metres * np.array(root[:3])) @ turned}
    waiting = ["root"]
    while waiting:
        parent = waiting.pop()
        for name in children.get(parent, []):
            bone = bones[name]
            axis = transform(Rotation.from_euler("xyz", list(map(float, bone["axis"].split()[:3])), degrees=True))
            angles = dict(zip(bone.get("dof", "").split(), values.get(name, []), strict=True))
            turn = transform(Rotation.from_euler("xyz", [angles.get(a, 0.0) for a in ("rx", "ry", "rz")], degrees=True))
            along = metres * float(bone["length"]) * np.array(list(map(float, bone["direction"].split())))
            matrices[name] = matrices[parent] @ axis @ turn @ np.linalg.inv(axis) @ transform(translation=along)
            waiting.append(name)
    return {name: world(matrix[:3, 3]) for name, matrix in matrices.items()}


def test_cmu_clip_matches_homogeneous_matrices(data):
    asf, amc = data / "cmu" / "35" / "35.asf", data / "cmu" / "35" / "35_01.amc"
    clip = read_amc(amc)
    assert (clip.first_frame, len(clip), clip.rate_hz) == (135, 224, 120.0)
    for frame in (0, 100, 223):
        ends = cmu_bone_ends(asf, amc, 135 + frame)
        for joint, parent, place in zip(clip.joints, clip.parents, clip.positions[frame], strict=True):
            # a joint is the near end of its bone: the far end of its parent's
            expected = ends["root"] if parent <= 0 else ends[clip.joints[parent]]
            np.testing.assert_allclose(place, expected, atol=1e-9, err_msg=joint)


def bvh_joint_places(text, frame):
    """{joint: place} in the world, m, of a BVH file in centimetres whose every joint has 6 channels, by recursion."""
    words = text.split()
    motion = words.index("MOTION")
    values = list(map(float, words[motion + 6 :]))
    n_channels = words[:motion].count("Xrotation") * 6
    values = iter(values[frame * n_channels : (frame + 1) * n_channels])
    tokens = iter(words[:motion])
    places = {}

    def joint(parent):
        name = next(tokens)
        assert [next(tokens), next(tokens)] == ["{", "OFFSET"]
        [next(tokens) for _ in range(3)]
        assert [next(tokens), next(tokens)] == ["CHANNELS", "6"]
        shift, turns = np.zeros(3), np.eye(4)
        for channel in [next(tokens) for _ in range(6)]:
            if channel.endswith("position"):
                shift["XYZ".index(channel[0])] = 0.01 * next(values)
            else:  # every further turn is about an axis that the turns before have turned
                axis = np.eye(3)["XYZ".index(channel[0])]
                turns = turns @ transform(Rotation.from_rotvec(np.deg2rad(next(values)) * axis))
        return name, parent @ transform(translation=shift) @ turns

    def body(parent):
        name, matrix = joint(parent)
        places[name] = world(matrix[:3, 3])
        while (token := next(tokens)) != "}":
            if token == "JOINT":
                body(matrix)
            else:
                assert token == "End"
                [next(tokens) for _ in range(7)]  # Site { OFFSET x y z }

    assert [next(tokens), next(tokens)] == ["HIERARCHY", "ROOT"]
    body(np.eye(4))
    return places


def test_bandai_clip_matches_homogeneous_matrices(data):
    path = data / "bandai" / "dataset-1" / "dataset-1_walk_normal_001.bvh"
    if not path.is_file():
        pytest.skip(f"no Bandai recordings in {data}")
    clip = read_bvh(path)
    assert (len(clip), clip.rate_hz) == (195, 30.0)
    for frame in (0, 77, 194):
        places = bvh_joint_places(path.read_text(), frame)
        assert set(places) == {name for name in clip.joints if not name.endswith("_end")}
        for joint, expected in places.items():
            np.testing.assert_allclose(clip.positions[frame, clip.joint(joint)], expected, atol=1e-9, err_msg=joint)


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
