"""A marginal's picture: the truth where its values are, ends of the axis in degrees, gaps where no truth is known."""

import cv2
import numpy as np
import pytest

from workbench.recording.write import posterior
from workbench.recording.write.marginals import LOWEST_LOG_MASS

FRAMES = list(range(10, 16))


def drawn(truth, unit="rad", axis=(0.0, np.pi / 2.0)):
    """{entity below the picture: archetypes} of a marginal whose mass is all in the second of four bins."""
    log_mass = np.full((4, len(FRAMES)), LOWEST_LOG_MASS)
    log_mass[1] = 0.0
    found = {}
    for path, archetype in posterior.marginal_picture("knee", unit, axis, log_mass, FRAMES, np.asarray(truth)):
        found.setdefault(path.removeprefix(f"{posterior.PICTURES}/knee").strip("/"), []).append(archetype)
    return found


def test_the_truth_lies_on_the_bin_that_holds_it():
    found = drawn(np.full(6, 0.3 * np.pi / 2.0))
    blob = np.asarray(found["mass"][0].blob.as_arrow_array().to_pylist()[0], dtype=np.uint8)
    rows = cv2.imdecode(blob, cv2.IMREAD_COLOR).sum(axis=2)
    assert rows.shape == (4, 6)
    assert set(rows.argmax(axis=0)) == {2}  # the second from below
    (strip,) = found["truth"][0].strips.as_arrow_array().to_pylist()
    np.testing.assert_allclose(np.array(strip), [[(k + 0.5) * 320.0 / 6.0, 0.7 * 80.0] for k in range(6)], atol=1e-4)


@pytest.mark.parametrize(("unit", "ends"), [("rad", ["90", "0"]), ("m", ["1.57", "0"])])
def test_the_axis_says_its_values(unit, ends):
    labels = drawn(np.zeros(6), unit)["values"][0].labels.as_arrow_array().to_pylist()
    assert labels == [*ends, "#10", "#15"]


def test_what_is_not_known_or_outside_is_not_drawn():
    strips = drawn([0.1, 0.1, np.nan, 9.0, 0.2, 0.2])["truth"][0].strips.as_arrow_array().to_pylist()
    assert [len(strip) for strip in strips] == [2, 2]
    assert len(drawn(np.full(6, np.nan))["truth"][0].strips.as_arrow_array()) == 0
