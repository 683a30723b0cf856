"""BVH and Acclaim files of random skeletons and movements, against 4×4 matrices."""

import logging
import re
from itertools import permutations

import numpy as np
import pytest
import valid_files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.utils.errors import InputError

WORLD = [2, 0, 1]  # world x, y, z are the file's z, x, y
QUICK = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
TOLERANCE_M = 1e-6  # numbers are written with 9 significant digits and the coordinates stay below 100 m

NUMBERS = st.sampled_from(
    [
        lambda x: f"{x:.9f}",
        lambda x: f"{x:.9g}",
        lambda x: f"{x:+.9e}",
        lambda x: f"{x:.9E}".replace("E-", "E-0").replace("E+", "E+0"),  # three digits, as Windows prints exponents
    ]
)
NEWLINES = st.sampled_from(["\n", "\r\n"])


@st.composite
def trees(draw):
    """Draw the parents of 2 to 7 joints, -1 for the first."""
    n = draw(st.integers(2, 7))
    return [-1, *[draw(st.integers(0, k - 1)) for k in range(1, n)]]


def turn(axis, degrees):
    """Return the 4×4 rotation about the file's axis "X", "Y" or "Z"."""
    a, b = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis.upper()]
    s, c = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
    matrix = np.eye(4)
    matrix[a, a], matrix[a, b], matrix[b, a], matrix[b, b] = c, -s, s, c
    return matrix


def shift(vector):
    matrix = np.eye(4)
    matrix[:3, 3] = vector
    return matrix


@QUICK
@given(data=st.data())
def test_a_bvh_file_gives_the_joints_of_its_matrices(data, tmp_path):
    parents, number, newline = data.draw(trees()), data.draw(NUMBERS), data.draw(NEWLINES)
    unit, metres = data.draw(st.sampled_from([("cm", 0.01), ("m", 1.0)]))
    indent, same_line = data.draw(st.sampled_from([" ", "\t"])), data.draw(st.booleans())
    n_frames = data.draw(st.integers(1, 4))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    offsets = rng.uniform(-0.2, 0.2, (len(parents), 3)) / metres  # slower at 5 Hz than a row that is no motion
    turns = [data.draw(st.sampled_from(list(permutations("XYZ")))) for _ in parents]
    has_positions = [data.draw(st.booleans()) for _ in parents]
    channels = []
    for k in range(len(parents)):
        names = [f"{axis}rotation" for axis in turns[k]]
        if has_positions[k]:  # positions anywhere among the rotations
            for name in ("Yposition", "Xposition", "Zposition"):
                names.insert(data.draw(st.integers(0, len(names))), name)
        channels.append(names)
    order = depth_first(parents)
    values = [
        {k: {c: rng.uniform(-360, 360) if c.endswith("rotation") else rng.uniform(-0.2, 0.2) / metres
             for c in channels[k]} for k in order} for _ in range(n_frames)
    ]  # fmt: skip

    lines = ["HIERARCHY", *bvh_joint(0, parents, offsets, channels, number, indent, same_line), "MOTION"]
    lines += [f"Frames:\t{n_frames}", "Frame Time: 0.2"]
    lines += [" ".join(number(row[k][c]) for k in order for c in channels[k]) for row in values]
    path = tmp_path / "random.bvh"
    path.write_bytes((newline.join(lines) + newline).encode())
    clip = read_bvh(path, unit)

    assert clip.rate_hz == 5.0
    assert len(clip) == n_frames
    for frame, row in enumerate(values):
        matrices = {-1: np.eye(4)}
        for k in order:
            offset = [row[k].get(f"{axis}position", offsets[k, i]) for i, axis in enumerate("XYZ")]
            matrices[k] = matrices[parents[k]] @ shift(metres * np.array(offset))
            for axis in turns[k]:
                matrices[k] = matrices[k] @ turn(axis, row[k][f"{axis}rotation"])
            position = clip.positions[frame, clip.joint(f"joint {k}")]
            np.testing.assert_allclose(position, matrices[k][:3, 3][WORLD], atol=TOLERANCE_M)
            orientation = clip.orientations[frame, clip.joint(f"joint {k}")]
            np.testing.assert_allclose(orientation, matrices[k][:3, :3][np.ix_(WORLD, WORLD)], atol=TOLERANCE_M)
            if k not in parents:
                end = matrices[k] @ [*(metres * offsets[k]), 1.0]  # `bvh_joint` repeats the joint's offset
                position = clip.positions[frame, clip.joint(f"joint {k}_end")]
                np.testing.assert_allclose(position, end[:3][WORLD], atol=TOLERANCE_M)


def depth_first(parents, k=0):
    return [k, *[j for child, parent in enumerate(parents) if parent == k for j in depth_first(parents, child)]]


def bvh_joint(k, parents, offsets, channels, number, indent, same_line):
    offset = "OFFSET " + " ".join(map(number, offsets[k]))
    inner = [offset, f"CHANNELS {len(channels[k])} " + " ".join(channels[k])]
    for child, parent in enumerate(parents):
        if parent == k:
            inner += bvh_joint(child, parents, offsets, channels, number, indent, same_line)
    if k not in parents:
        inner += ["End Site", "{", indent + offset, "}"]
    head = f"{'ROOT' if k == 0 else 'JOINT'} joint {k}"
    return [*([f"{head} {{"] if same_line else [head, "{"]), *[indent + line for line in inner], "}"]


@QUICK
@given(data=st.data())
def test_an_acclaim_file_gives_the_joints_of_its_matrices(data, tmp_path):
    parents, number, newline = data.draw(trees()), data.draw(NUMBERS), data.draw(NEWLINES)
    bones = ["root", *[f"bone{k}" for k in range(1, len(parents))]]
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    directions = rng.normal(size=(len(parents), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths, unit = rng.uniform(0, 10, len(parents)), data.draw(st.sampled_from([0.45, 1.0]))
    lengths[0] = 0.0
    axes, axes[0] = rng.uniform(-180, 180, (len(parents), 3)), 0.0
    orders = [data.draw(st.sampled_from(["".join(p) for p in permutations("XYZ")])) for _ in parents]
    turns = st.lists(st.sampled_from(["rx", "ry", "rz"]), unique=True, max_size=3)
    channels = [data.draw(st.permutations(["tx", "ty", "tz", "rx", "ry", "rz"]))]
    channels += [data.draw(turns) for _ in parents[1:]]
    first, n_frames = data.draw(st.integers(0, 500)), data.draw(st.integers(1, 4))
    angle, amc_angle = data.draw(st.sampled_from(["deg", "rad"])), data.draw(st.sampled_from([None, "deg", "rad"]))
    motion_angle = amc_angle or angle
    degrees = [  # angles, and the root's shifts in units of the file
        [{c: rng.uniform(-180, 180) if c[0] == "r" else rng.uniform(-10, 10) for c in names} for names in channels]
        for _ in range(n_frames)
    ]

    write_asf(tmp_path / "s.asf", bones, parents, directions, lengths, unit, axes, orders, channels, angle,
              number, newline)  # fmt: skip
    lines = ["# a comment", ":FULLY-SPECIFIED", *{None: [], "deg": [":DEGREES"], "rad": [":RADIANS"]}[amc_angle]]
    for frame, row in enumerate(degrees):
        lines.append(str(first + frame))
        for k in rng.permutation(len(parents)):  # bones may come in any order
            if channels[k]:
                written = [to_unit(row[k][c], motion_angle) if c[0] == "r" else row[k][c] for c in channels[k]]
                lines.append(" ".join([bones[k], *map(number, written)]))
    (tmp_path / "s_01.amc").write_bytes((newline.join(lines) + newline).encode())
    clip = read_amc(tmp_path / "s_01.amc", rate_hz=5.0)

    assert (len(clip), clip.rate_hz) == (n_frames, 5.0)
    metres = 0.0254 / unit
    for frame, row in enumerate(degrees):
        matrices = {}
        for k in depth_first(parents):
            if k == 0:
                start = shift(metres * np.array([row[0][c] for c in ("tx", "ty", "tz")]))
            else:
                start = matrices[parents[k]] @ shift(metres * lengths[parents[k]] * directions[parents[k]])
            axis, rotation = np.eye(4), np.eye(4)
            for letter in orders[k]:  # about fixed axes: later turns multiply from the left
                axis = turn(letter, axes[k]["XYZ".index(letter)]) @ axis
                rotation = turn(letter, row[k].get(f"r{letter.lower()}", 0.0)) @ rotation
            matrices[k] = start @ axis @ rotation @ np.linalg.inv(axis)
            position = clip.positions[frame, clip.joint(bones[k])]
            np.testing.assert_allclose(position, start[:3, 3][WORLD], atol=TOLERANCE_M)
            if k not in parents and k > 0:
                end = matrices[k] @ [*(metres * lengths[k] * directions[k]), 1.0]
                position = clip.positions[frame, clip.joint(f"{bones[k]}_end")]
                np.testing.assert_allclose(position, end[:3][WORLD], atol=TOLERANCE_M)


def to_unit(degrees, unit):
    return degrees if unit == "deg" else np.deg2rad(degrees)


def write_asf(path, names, parents, directions, lengths, unit, axes, orders, channels, angle, number, newline):
    lines = ["# a comment", ":version 1.10", ":name someone", ":units", " mass 1.0", f" length {unit}",
             f" angle {angle}", ":documentation", " begin with any words", ":root", f" axis {orders[0]}",
             " order " + " ".join(channels[0]).upper(), " position 0 0 0", " orientation 0 0 0",
             ":bonedata"]  # fmt: skip
    for k in range(1, len(names)):
        turned = " ".join(number(to_unit(a, angle)) for a in axes[k])
        lines += [" begin", f"  id {k}", f"  name {names[k]}", "  direction " + " ".join(map(number, directions[k])),
                  f"  length {number(lengths[k])}", f"  axis {turned} {orders[k]}"]  # fmt: skip
        if channels[k]:
            lines += ["  dof " + " ".join(channels[k]), "  limits (-10.0 170.0)", "         (-20.0 20.0)"]
        lines.append(" end")
    lines += [":hierarchy", " begin"]
    for k, name in enumerate(names):
        if k in parents:
            lines.append("  " + " ".join([name, *[names[c] for c, parent in enumerate(parents) if parent == k]]))
    path.write_bytes((newline.join([*lines, " end"]) + newline).encode())


def test_the_skeleton_file_can_be_chosen(tmp_path):
    (tmp_path / "5.asf").write_text(valid_files.ASF)
    (tmp_path / "5_01.amc").write_text(valid_files.AMC)
    clip = read_amc(tmp_path / "5_01.amc")
    assert len(clip) == 2
    (tmp_path / "elsewhere.asf").write_text(valid_files.ASF.replace("length 7", "length 14"))
    longer = read_amc(tmp_path / "5_01.amc", asf=tmp_path / "elsewhere.asf")
    assert longer.offsets == pytest.approx(2 * clip.offsets)
    with pytest.raises(InputError, match="expected a rate of"):
        read_amc(tmp_path / "5_01.amc", rate_hz=0.0)


def amc(folder, text, name="5_01.amc", asf="5.asf"):
    (folder / asf).write_text(valid_files.ASF)
    (folder / name).write_text(text)
    return folder / name


def test_the_skeleton_is_the_one_in_the_folder(tmp_path, caplog):
    path = amc(tmp_path, valid_files.AMC, "subject7-walk-01.amc", "other.asf")
    assert len(read_amc(path)) == 2
    assert "its skeleton is taken to be that of other.asf" in caplog.text
    caplog.clear()
    (tmp_path / "subject7.asf").write_text(valid_files.ASF.replace("length 7", "length 14"))
    (tmp_path / "subj.asf").write_text("not this one")
    assert np.abs(read_amc(path, rate_hz=60.0).offsets).max() == pytest.approx(14 * 0.0254 / 0.45)
    assert not [record for record in caplog.records if record.levelname == "WARNING"]
    (tmp_path / "subject7.asf").unlink()
    (tmp_path / "subj.asf").rename(tmp_path / "third.asf")
    with pytest.raises(InputError, match=r"no such file, found other.asf, third.asf; give the skeleton \(--asf\)"):
        read_amc(path)


def test_the_rate_is_chosen_or_read_or_assumed(tmp_path, caplog):
    path = amc(tmp_path, valid_files.AMC)
    assert read_amc(path).rate_hz == 120.0
    assert "an AMC file has no rate; read at 120 Hz" in caplog.text
    caplog.clear()
    assert read_amc(path, rate_hz=30.0).rate_hz == 30.0
    path = amc(tmp_path, valid_files.AMC.replace(":DEGREES", ":samples-per-second 60\n:degrees"))
    assert read_amc(path).rate_hz == 60.0
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_frame_numbers_give_the_times(tmp_path, caplog):
    frames = "".join(f"{number}\nroot {number} 0 0 0 0 0\nthigh 1 2\n" for number in (10, 12, 14, 20))
    clip = read_amc(amc(tmp_path, ":DEGREES\n" + frames))
    assert (len(clip), clip.rate_hz) == (6, 60.0)
    x = clip.positions[:, 0, WORLD.index(0)] * 0.45 / 0.0254
    assert x == pytest.approx([10, 12, 14, 14, 14, 20])
    assert "the frame numbers increase by 2" in caplog.text
    assert "2 of 6 frames lack values" in caplog.text


def test_a_missing_bone_repeats_its_last_value(tmp_path, caplog):
    text = ":DEGREES\n1\nroot 0 0 0 0 0 0\nthigh 30 0\n2\nroot 0 0 0 0 0 0\n3\nroot 0 0 0 0 0 0\nthigh nan nan\n"
    clip = read_amc(amc(tmp_path, text))
    np.testing.assert_array_equal(clip.rotations, clip.rotations[[0, 0, 0]])
    assert not np.allclose(clip.rotations[0, 1], np.eye(3))
    assert "some frames lack thigh" in caplog.text
    assert "2 of 3 frames lack values" in caplog.text
    always_missing = read_amc(amc(tmp_path, ":DEGREES\n1\nroot 0 0 0 0 0 0\n2\nroot 0 0 0 0 0 0\n"))
    np.testing.assert_allclose(always_missing.rotations[:, 1], np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-15)


LEG = "".join(
    f"  begin\n    name {side}{bone}\n    direction 0 -1 0\n    length {length}\n    axis 0 0 0 XYZ\n  end\n"
    for side in "lr"
    for bone, length in (("hipjoint", 2.0), ("femur", 7.3), ("tibia", 7.3), ("foot", 2.0))
)
LEGS = f""":units
UNITS
:root
  order TX TY TZ RX RY RZ
:bonedata
{LEG}:hierarchy
  begin
    root lhipjoint rhipjoint
    lhipjoint lfemur
    lfemur ltibia
    ltibia lfoot
    rhipjoint rfemur
    rfemur rtibia
    rtibia rfoot
  end
"""


@pytest.mark.parametrize(
    ("units", "message"),
    [("", "read in cmu"), ("length 0.45", "read in 0.05644 m"), ("length 1", "by the file it would")],
)
def test_the_unit_of_a_skeleton_is_checked_by_the_person(tmp_path, caplog, units, message):
    """In inches the person is 0.75 m tall, in the unit of the CMU database 1.7 m; both are plausible."""
    caplog.set_level(logging.INFO)
    (tmp_path / "5.asf").write_text(LEGS.replace("UNITS", units))
    (tmp_path / "5_01.amc").write_text(":DEGREES\n1\nroot 0 17 0 0 0 0\n2\nroot 0 17 0 0 0 0\n")
    clip = read_amc(tmp_path / "5_01.amc")
    knee, ankle = (clip.joints.index(name) for name in ("ltibia", "lfoot"))
    assert np.linalg.norm(clip.positions[0, knee] - clip.positions[0, ankle]) == pytest.approx(7.3 * 0.0254 / 0.45)
    assert message in caplog.text


def test_the_position_of_the_root_and_constant_lengths_are_read(tmp_path):
    path, asf = amc(tmp_path, valid_files.AMC), tmp_path / "5.asf"
    expected = read_amc(path)
    asf.write_text(re.sub(r"position 0 0 0", "position 1 2 3", valid_files.ASF))
    shift = np.array([3.0, 1.0, 2.0]) * 0.0254 / 0.45
    np.testing.assert_allclose(read_amc(path).positions, expected.positions + shift, atol=1e-12)
