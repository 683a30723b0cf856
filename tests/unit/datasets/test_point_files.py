"""Readers of point files: points are read back, and errors name the file and the place."""

import struct

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as numbers

from workbench.datasets import point_formats
from workbench.datasets.point_files import PointFiles
from workbench.datasets.point_formats import READERS, read_csv, read_hdf5, read_npy, read_npz, read_pcd, read_ply
from workbench.motion.library import write_library
from workbench.motion.synthetic.gait import builtin_motions
from workbench.utils.errors import InputError
from workbench.utils.text import natural_order

coordinate = st.floats(-1e6, 1e6, allow_nan=False)
clouds = numbers.arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=coordinate)
line_ends = st.sampled_from(["\n", "\r\n"])
few_examples = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=30)
EXTRA = {"uchar": "B", "float": "f", "int": "i", "short": "h"}


@pytest.fixture(autouse=True)
def without_sandbox(trusted):
    """Read HDF5 directly; the sandbox is for tests/robustness."""


def ply_header(form, n, properties, more=""):
    lines = ["ply", f"format {form} 1.0", "comment made up", f"element vertex {n}", *properties]
    return "\n".join([*lines, *([more] if more else []), "end_header", ""])


def ascii_ply(points, more=""):
    body = "".join(" ".join(repr(float(x)) for x in row) + "\n" for row in points)
    return ply_header("ascii", len(points), [f"property double {a}" for a in "xyz"], more) + body


def binary_ply(points, order, extra=()):
    """Return a file of points with other properties before and after the coordinates."""
    kinds = [*[("double", a) for a in "xyz"], *[(kind, f"extra{i}") for i, kind in enumerate(extra)]]
    kinds = kinds[3:4] + kinds[:3] + kinds[4:]
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    header = ply_header(form, len(points), [f"property {kind} {name}" for kind, name in kinds])
    rows = b"".join(
        struct.pack(order + "".join({"double": "d", **EXTRA}[kind] for kind, _ in kinds),
                    *[row["xyz".index(name)] if name in "xyz" else 7 for _, name in kinds])
        for row in points
    )  # fmt: skip
    return header.encode() + rows


def error_message(read, path):
    with pytest.raises(InputError) as error:
        read(path)
    message = str(error.value)
    assert str(path) in message
    assert "\n" not in message
    return message


@few_examples
@given(points=clouds, line=line_ends, faces=st.booleans())
def test_ascii_ply_is_read_back(tmp_path, points, line, faces):
    more = "element face 1\nproperty list uchar int vertex_indices" if faces else ""
    text = ascii_ply(points, more) + ("3 0 0 0\n" if faces else "")
    (tmp_path / "a.ply").write_bytes(text.replace("\n", line).encode())
    assert np.array_equal(read_ply(tmp_path / "a.ply"), points)


@few_examples
@given(points=clouds, order=st.sampled_from("<>"), extra=st.lists(st.sampled_from(sorted(EXTRA)), max_size=3))
def test_binary_ply_is_read_back(tmp_path, points, order, extra):
    (tmp_path / "a.ply").write_bytes(binary_ply(points, order, extra))
    assert np.array_equal(read_ply(tmp_path / "a.ply"), points)


@few_examples
@given(points=clouds, order=st.permutations(["x", "y", "z", "red"]), bom=st.booleans(), line=line_ends)
def test_csv_is_read_back(tmp_path, points, order, bom, line):
    rows = [",".join("9" if c == "red" else repr(float(row["xyz".index(c)])) for c in order) for row in points]
    text = line.join([", ".join(order), *rows, ""])
    (tmp_path / "a.csv").write_bytes(text.encode("utf-8-sig" if bom else "utf-8"))
    assert np.array_equal(read_csv(tmp_path / "a.csv"), points)


@few_examples
@given(points=clouds, name=st.sampled_from(["points", "cloud"]), kind=st.sampled_from(["f4", "f8", ">f8", "i4"]))
def test_npz_is_read_back(tmp_path, points, name, kind):
    values = points.astype(kind)
    np.savez(tmp_path / "a.npz", **{name: values})
    assert np.array_equal(read_npz(tmp_path / "a.npz"), values.astype(np.float64))


@few_examples
@given(frames=st.lists(clouds, min_size=1, max_size=12))
def test_hdf5_frames_are_read_in_the_order_of_their_numbers(tmp_path, frames):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for i, points in enumerate(frames):
            file[f"frames/{i}"] = points
    for read, points in zip(read_hdf5(tmp_path / "a.h5"), frames, strict=True):
        assert np.array_equal(read, points)


HEAD = ply_header("ascii", 2, [f"property double {a}" for a in "xyz"])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.ply", HEAD + "1 2 3\n4 5\n", ["line 10", "3 numbers (x, y, z)", "'4 5'"]),
        ("a.ply", HEAD + "1 2 3\n4 inf 6\n", ["line 10", "finite number for y", "'inf'"]),
        ("a.ply", HEAD + "1 2 3\n", ["2 rows", "1 lines"]),
        ("a.ply", HEAD.replace("double z", "list uchar int z"), ["line 7", "list uchar int z"]),
        ("a.ply", HEAD.replace("ascii 1.0", "ascii 2.0"), ["line 2", "ascii 2.0"]),
        ("a.csv", "a,b,c\n", ["line 1", "columns x, y and z"]),
        ("a.csv", "x,y,z\n1,2,3\n1,2\n", ["line 3", "'1,2'"]),
        ("a.csv", "x,y,z\n1,2,3\n1,inf,3\n", ["line 3", "y", "'inf'"]),
        ("a.csv", "x,y,z,x\n1,2,3,4\n", ["line 1"]),
    ],
)
def test_the_error_of_an_invalid_line_names_it(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    message = error_message(read_ply if name.endswith("ply") else read_csv, tmp_path / name)
    assert all(word in message for word in words), message


def test_the_error_of_an_invalid_binary_row_names_it(tmp_path):
    points = np.ones((5, 3))
    points[3, 1] = np.inf
    (tmp_path / "a.ply").write_bytes(binary_ply(points, "<"))
    assert "vertex 4: expected finite x, y, z, found [1.0, inf, 1.0]" in error_message(read_ply, tmp_path / "a.ply")
    (tmp_path / "b.ply").write_bytes(binary_ply(np.ones((5, 3)), "<")[:-1])
    assert "5 vertices of 24 bytes, 120, found 119" in error_message(read_ply, tmp_path / "b.ply")
    np.savez(tmp_path / "a.npz", points=points)
    assert "points, row 4" in error_message(read_npz, tmp_path / "a.npz")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["frames/7"] = points
    assert "/frames/7, row 4" in error_message(lambda path: list(read_hdf5(path)), tmp_path / "a.h5")


@pytest.mark.parametrize(
    "arrays",
    [
        {"a": np.ones((2, 3)), "b": np.ones((2, 3))},
        {"points": np.ones((2, 2))},
        {"points": np.ones(3)},
        {},
        {"points": np.array([["a", "b", "c"]])},
        {"points": np.ones((2, 3), complex)},
        {"points": np.array([[None, 1, 2]])},
    ],
)
def test_npz_files_of_other_arrays_are_rejected(tmp_path, arrays):
    np.savez(tmp_path / "a.npz", **arrays)  # an array of objects is a pickle
    error_message(read_npz, tmp_path / "a.npz")


def folder_of(tmp_path, frames, unit=1.0):
    for i, points in enumerate(frames):
        np.savez(tmp_path / f"frame_{i}.npz", points=points / unit)
    return tmp_path


def test_a_folder_is_read_in_natural_order_and_converted_to_metres(tmp_path):
    rng = np.random.default_rng(0)
    points = [rng.standard_normal((4 + i, 3)) for i in range(12)]
    dataset = PointFiles(str(folder_of(tmp_path, points, 0.001)), rate_hz=20.0, unit="mm")
    frames = list(dataset.frames())
    info = dataset.info
    assert (info.n_frames, info.name, info.shape) == (12, tmp_path.name, None)
    assert (info.initial_pose, info.initial_annotations, info.phase_ends) == (None, None, None)
    for i, (frame, expected) in enumerate(zip(frames, points, strict=True)):
        assert (frame.index, frame.time_s, frame.views, frame.truth) == (i, pytest.approx(i / 20.0), (), None)
        assert np.allclose(frame.points, expected)


def test_large_clouds_are_subsampled_with_a_warning(tmp_path):
    points = np.random.default_rng(0).standard_normal((100_000, 3)).astype(np.float32)
    properties = "".join(f"property float {a}\n" for a in "xyz").strip()
    for name in ("frame_1.ply", "frame_2.ply"):
        (tmp_path / name).write_bytes(
            ply_header("binary_little_endian", len(points), [properties]).encode() + points.tobytes()
        )
    with pytest.warns(UserWarning, match=r"2 of 2 frames have more than max_points=3000 .* frame_1.ply with 100000"):
        _ = (dataset := PointFiles(str(tmp_path), max_points=3000)).info
    first, second = (frame.points for frame in dataset.frames())
    assert first.shape == (3000, 3)
    assert np.isin(first.astype(np.float32)[:, 0], points[:, 0]).all()
    assert not np.array_equal(first, second)  # frames are subsampled independently
    with pytest.warns(UserWarning, match="subsampled"):
        _ = (repeated := PointFiles(str(tmp_path), max_points=3000)).info
    assert np.array_equal(first, next(repeated.frames()).points)


def test_the_truth_defines_poses_shape_and_initial_pose(tmp_path):
    (motion,) = builtin_motions(1, seed=3)
    write_library(tmp_path / "lib.h5", [motion])
    (tmp_path / "clouds").mkdir()
    folder = str(folder_of(tmp_path / "clouds", [np.ones((5, 3))] * 15))
    truth = f"{tmp_path / 'lib.h5'}:{motion.name}"
    dataset = PointFiles(folder, rate_hz=15.0, truth=truth, truth_first_frame=-2, initialization="perturbed_truth")
    for i, frame in enumerate(dataset.frames()):
        assert np.allclose(frame.truth.pose, motion.poses[4 * (i + 2)], atol=1e-9)  # knots of the spline at 60 Hz
        assert frame.truth.activity == "walk"
    assert dataset.info.shape == motion.shape
    # 5 standard deviations of 3 cm and 0.05 rad
    assert 0.0 < np.abs(dataset.info.initial_pose - motion.poses[8]).max() < 0.25
    assert dataset.info.phase_ends[1] > dataset.info.phase_ends[0]
    with pytest.raises(InputError, match="perturbed_truth needs the ground truth"):
        _ = PointFiles(folder, initialization="perturbed_truth").info
    with pytest.raises(InputError, match=r"lasts 6\.0\d s"):
        _ = PointFiles(folder, rate_hz=15.0, truth=truth, truth_first_frame=-100).info


def test_a_range_of_frames_is_identical_to_those_of_the_sequence(tmp_path):
    folder = str(folder_of(tmp_path, [np.full((40, 3), float(i)) + np.arange(40)[:, None] for i in range(5)]))
    all_frames, selection = (
        PointFiles(folder, max_points=30, **options) for options in ({}, {"first_frame": 1, "n_frames": 3})
    )
    with pytest.warns(UserWarning, match="frames have more than max_points=30 points"):
        all_frames, selection = list(all_frames.frames()), list(selection.frames())
    assert [(frame.index, frame.time_s) for frame in selection] == [(i, i / 14.0) for i in (1, 2, 3)]
    assert all(
        np.array_equal(frame.points, expected.points)
        for frame, expected in zip(selection, all_frames[1:], strict=False)
    )


@pytest.mark.parametrize(
    ("files", "words"),
    [([], ["found none"]), (["note.txt"], ["found none"]), (["a.ply", "b.csv"], ["one format", ".csv, .ply"])],
)
def test_a_folder_without_points_is_an_error(tmp_path, files, words):
    for name in files:
        (tmp_path / name).touch()
    with pytest.raises(InputError) as error:
        _ = PointFiles(str(tmp_path)).info
    assert all(word in str(error.value) for word in [str(tmp_path), *words])


def test_sources_without_points_are_an_error(tmp_path):
    with h5py.File(tmp_path / "none.h5", "w") as file:
        file["points"] = np.ones((3, 3))
    with h5py.File(tmp_path / "group.h5", "w") as file:
        file.create_group("frames/0")
    for name, words in (("nowhere", "a folder"), ("none.h5", "/frames, found none"), ("group.h5", "/frames/0")):
        with pytest.raises(InputError, match=words):
            _ = PointFiles(str(tmp_path / name)).info
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.ply").mkdir()
    with pytest.raises(InputError, match="expected a file, found a folder"):
        _ = PointFiles(str(tmp_path / "sub")).info


def pcd(points, binary):
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y rgb z\nSIZE 4 4 4 8\nTYPE F F U F\nCOUNT 1 1 1 1\n"
    head += f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA {'binary' if binary else 'ascii'}\n"
    rows = [struct.pack("<ffId", x, y, 7, z) if binary else f"{x} {y} 7 {z}\n".encode() for x, y, z in points]
    return head.encode() + b"".join(rows)


POINTS = np.array([[1.5, -2.25, 0.5], [0.25, 4.0, -1.0]])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", b"X,Y,Z\n1.5,-2.25,0.5\n0.25,4,-1\n"),
        ("a.csv", b"\xef\xbb\xbf//X (m);Y (m);Z (m);I\r\n1,5;-2,25;0,5;3\r\n0,25;4;-1;3\r\n"),
        ("a.csv", b'"x_m","y_m","z_m"\n1.5,-2.25,0.5\nnan,nan,nan\n1,,2\n0.25,4,-1\n'),
        ("a.csv", "I,Points:0,Points:1,Points:2\n1,1.5,-2.25,.5\n2,.25,4,-1\n".encode("utf-16")),
        ("a.csv", "X [m],Y [m],Z [m],Höhe\n1.5,-2.25,0.5,1\n0.25,4,-1,2\n".encode("latin-1")),
        ("a.xyz", b"1.5 -2.25 0.5 9\n0.25 4 -1 9\n"),
        ("a.xyz", b"2\n1.5 -2.25 0.5\n0.25 4 -1\n"),
        ("a.xyz", b"2\nby hand\n1.5\t-2.25\t0.5\n0.25\t4\t-1\n"),
        ("a.xyz", b"# made by hand\n# Z X Y\n0.5 1.5 -2.25\n-1 0.25 4\n"),
        ("a.XYZ", b"X Y Z\n1.5 -2.25 0.5\n0.25 4 -1\n"),
        ("a.pcd", pcd(POINTS, binary=False).replace(b"x y rgb z", b"X Y rgb Z").replace(b"POINTS 2\n", b"")),
        ("a.ply", ascii_ply(POINTS).replace("double x", "double X").replace("ply\n", "PLY\n", 1).encode()),
        ("a.pcd", pcd(POINTS, binary=True)),
        ("a.pcd", pcd(POINTS, binary=False)),
        ("a.ply", (ascii_ply(np.vstack([POINTS, [np.nan, 1.0, 2.0]]))).encode()),
    ],
)
def test_formats_and_dialects_give_the_same_points(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    assert np.array_equal(READERS[name[1:].lower()](tmp_path / name), POINTS)


def test_arrays_with_more_columns_or_named_fields_are_points(tmp_path):
    fields = np.zeros(2, [("x", "f8"), ("z", "f8"), ("y", "f4"), ("i", "u1")])
    for k, axis in enumerate("xyz"):
        fields[axis] = POINTS[:, k]
    for values in (POINTS, np.hstack([POINTS, np.ones((2, 3))]), fields):
        np.save(tmp_path / "a.npy", values)
        np.savez(tmp_path / "a.npz", values)
        assert np.array_equal(read_npy(tmp_path / "a.npy"), POINTS)
        assert np.array_equal(read_npz(tmp_path / "a.npz"), POINTS)
    for name in ("points", "Points", "xyz"):
        np.savez(tmp_path / "a.npz", rgb=np.ones((2, 3)), **{name: POINTS})
        assert np.array_equal(read_npz(tmp_path / "a.npz"), POINTS)
    (tmp_path / "a.npy").write_bytes(b"no array")
    error_message(read_npy, tmp_path / "a.npy")
    for content in (b"VERSION 0.7\n", pcd(POINTS, True)[:-1], pcd(POINTS, True).replace(b"x y", b"u v"),
                    pcd(POINTS, True).replace(b"WIDTH 2", b"WIDTH two")):  # fmt: skip
        (tmp_path / "a.pcd").write_bytes(content)
        error_message(read_pcd, tmp_path / "a.pcd")


@few_examples
@given(times=st.lists(st.integers(0, 40_000), min_size=2, max_size=20, unique=True))
def test_files_are_ordered_by_time(times):
    """Times are multiples of 1/16 s, written without trailing zeros."""
    names = [f"cloud_{time / 16}.ply" for time in times]
    assert natural_order(names) == [(f"cloud_{time / 16}.ply", time / 16) for time in sorted(times)]


def test_decimals_of_constant_length_are_counters():
    names = [f"scan 1.{k}.ply" for k in range(1, 31)]
    assert [name for name, _ in natural_order(names[::-1])] == names
    assert natural_order(["b.ply", "a2.ply", "a10.ply"]) == [("a2.ply", 2.0), ("a10.ply", 10.0), ("b.ply", None)]


def test_empty_and_missing_frames_are_gaps(tmp_path, caplog):
    for time in (12.0, 12.1, 12.2, 12.5):
        rows = "" if time == 12.1 else "1,2,3\n"
        (tmp_path / f"{time}.csv").write_text(f"x,y,z\n{rows}")
    (tmp_path / "._12.0.csv").write_text("a resource fork")
    frames = list(PointFiles(str(tmp_path), rate_hz=20.0, up="y").frames())
    assert [len(frame.points) for frame in frames] == [1, 0, 1, 0, 0, 1]
    assert np.array_equal(frames[0].points, [[3.0, 1.0, 2.0]])
    assert "2 of 6 files are missing" in caplog.text
    assert "set rate_hz to 10, found 20" in caplog.text
    for file in tmp_path.iterdir():
        file.write_text("x,y,z\n")
    with pytest.raises(InputError, match="expected points, found none in 6 frames"):
        _ = PointFiles(str(tmp_path)).info


@pytest.mark.parametrize(("factor", "unit"), [(1.0, None), (100.0, None), (1000.0, None), (39.37007874, "inch")])
def test_the_unit_is_inferred_from_the_size_of_a_person_or_chosen(tmp_path, factor, unit):
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 3))
    np.save(tmp_path / "0.npy", factor * points)
    (frame,) = PointFiles(str(tmp_path), unit=unit).frames()
    np.testing.assert_allclose(frame.points, points)
    with pytest.raises(InputError, match="unit must be one of"):
        PointFiles(str(tmp_path), unit="ell")


@pytest.mark.parametrize("more", [0, 1])
@pytest.mark.parametrize("name", ["a.xyz", "a.ply", "a.pcd"])
def test_large_text_files_are_rejected_with_a_remedy(tmp_path, monkeypatch, name, more):
    head = {"a.xyz": "", "a.ply": PLY_HEAD, "a.pcd": PCD_HEAD}[name]
    (tmp_path / name).write_text(f"{head}1 2 3\n")
    monkeypatch.setattr(point_formats, "_MAX_TEXT", (tmp_path / name).stat().st_size - more)
    if more:
        assert "write a binary file" in error_message(READERS[name[1:]], tmp_path / name)
    else:
        assert READERS[name[1:]](tmp_path / name).tolist() == [[1.0, 2.0, 3.0]]


PLY_HEAD = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
PCD_HEAD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n"
