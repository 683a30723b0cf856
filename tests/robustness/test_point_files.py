"""Damaged point files in PLY, CSV and NPZ, and archives larger than memory; HDF5: see test_hdf5."""

import warnings

import numpy as np
import pytest
from damage import changes, flips, refusal, withstands
from valid_files import PLY, written

from workbench.datasets.point_files import PointFiles
from workbench.datasets.point_formats import read_csv, read_npz, read_ply
from workbench.utils.input_limits import MAX_NUMBERS


def finite(read):
    """Return a reader that checks that the points are finite (n, 3) and that no warning is raised."""

    def checked(path):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            points = read(path)
        assert points.ndim == 2
        assert points.shape[1] == 3
        assert np.isfinite(points).all()

    return checked


def binary_ply(order):
    header = PLY[: PLY.index("1 2 3")].replace("ascii", f"binary_{order}_endian")
    return header.encode() + np.arange(6).astype("<f4" if order == "little" else ">f4").tobytes()


@pytest.mark.parametrize("content", [PLY, binary_ply("little"), binary_ply("big")], ids=["ascii", "little", "big"])
@pytest.mark.slow
def test_random_damage_to_ply_is_refused_or_read(tmp_path, content):
    withstands(finite(read_ply), written(tmp_path / "a.ply", content), 150)


def test_random_damage_to_csv_is_refused_or_read(tmp_path):
    withstands(finite(read_csv), written(tmp_path / "a.csv", "x,y,z,w\n1,2,3,4\n4,5,6,7\n"), 150)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_random_damage_to_npz_is_refused_or_read(tmp_path, save):
    save(tmp_path / "a.npz", points=np.arange(12.0).reshape(4, 3))
    withstands(finite(read_npz), tmp_path / "a.npz", 150, changes | flips)


def test_an_archive_of_objects_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.array([print, None], dtype=object))
    assert "Object arrays cannot be loaded" in refusal(read_npz, tmp_path / "a.npz")


def test_an_archive_larger_than_memory_is_refused(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "a.npz", points=np.zeros((2000, 3)))
    monkeypatch.setattr("workbench.datasets.point_formats.MAX_NUMBERS", 5000)
    assert "bytes of arrays" in refusal(read_npz, tmp_path / "a.npz")
    assert MAX_NUMBERS > 5000


def test_a_header_with_more_vertices_than_the_file_is_refused(tmp_path):
    for content in (PLY.encode(), binary_ply("little")):
        many = content.replace(b"vertex 2", b"vertex 999999999999999999")
        assert "expected" in refusal(read_ply, written(tmp_path / "a.ply", many))


def test_points_10_000_km_away_are_refused(tmp_path):
    written(tmp_path / "a.csv", "x,y,z\n1,2,1e8\n")
    points = PointFiles(str(tmp_path), unit="m")
    assert "frame 0: expected positions up to 1e+07 m, found 1e+08 m" in refusal(lambda: points.info)
