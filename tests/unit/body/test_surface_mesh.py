"""The mesh of the surface where scikit-image is installed, and the message where it is not."""

import importlib.util
import sys

import numpy as np
import pytest
import surface_scenes as scenes

from tests.oracles.surface import distances
from workbench.body.kinematics import forward
from workbench.body.surface_mesh import surface_mesh
from workbench.utils.errors import InputError

with_scikit_image = pytest.mark.skipif(
    importlib.util.find_spec("skimage") is None, reason="scikit-image, the extra 'mesh', is not installed"
)


def test_without_scikit_image_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage", None)
    monkeypatch.setitem(sys.modules, "skimage.measure", None)
    skeleton, surface = scenes.lone()
    with pytest.raises(InputError, match=r"\.\[mesh\]"):
        surface_mesh(surface, forward(skeleton, np.zeros((1, 6))))


def volume(vertices, triangles):
    a, b, c = vertices[triangles].swapaxes(0, 1)
    return np.sum(a * np.cross(b, c)) / 6.0


@with_scikit_image
def test_the_mesh_of_an_ellipsoid_is_closed_and_lies_on_it():
    half = np.array([0.05, 0.08, 0.2])
    skeleton, surface = scenes.lone(half)
    vertices, triangles = surface_mesh(surface, forward(skeleton, np.zeros((1, 6))), spacing_m=0.005)
    # chords of 5 mm leave a surface of the curvature 0.05 / 0.2² ... 0.2 / 0.05² by less than 0.25 mm
    np.testing.assert_allclose(np.linalg.norm(vertices / half, axis=1), 1.0, atol=0.005)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    # the volume is positive if the triangles face outward
    assert volume(vertices, triangles) == pytest.approx(4.0 / 3.0 * np.pi * half.prod(), rel=0.02)


@with_scikit_image
def test_the_mesh_of_a_person_lies_on_the_nearest_parts():
    skeleton, surface = scenes.PERSON
    frames = forward(skeleton, np.zeros((1, 25)))
    vertices, triangles = surface_mesh(surface, frames, spacing_m=0.03)
    nearest = distances(surface, frames, vertices).min(axis=1)
    assert np.abs(nearest).max() < 0.01  # a third of the grid: creases between parts are cut off
    assert 0.05 < volume(vertices, triangles) < 0.09  # m³, of an adult
