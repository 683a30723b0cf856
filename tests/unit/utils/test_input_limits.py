"""Limits on numbers in files and configurations, checked before arrays are allocated."""

import numpy as np
import pytest
from bandai_files import write_bandai_like

from workbench.body.shape import from_height
from workbench.datasets.point_files import PointFiles
from workbench.motion import sources
from workbench.motion.synthetic.gait import subjects, walker
from workbench.utils import input_limits
from workbench.utils.errors import LONGEST, InputError
from workbench.utils.input_limits import LONGEST_LIMB_M, MAX_COUNT, check_file, check_rate, check_sizes, parse_json


def refusal(check, *arguments, **keys):
    with pytest.raises(InputError) as caught:
        check(*arguments, **keys)
    return str(caught.value)


def test_a_message_is_short_and_encodable():
    message = str(InputError(f"a.toml: expected b, found {'x' * 3_000_000!r}"))
    assert len(message) == LONGEST
    assert message.startswith("a.toml: expected b, found 'xxx")
    assert " … " in message
    assert str(InputError("short")) == "short"
    str(InputError("a\ud800")).encode()


@pytest.mark.parametrize("rate", [0.0, -30.0, float("nan"), float("inf"), 1e300, 0.01])
def test_rates_out_of_range_are_rejected(rate, tmp_path):
    assert "found" in refusal(check_rate, "a.bvh", rate)
    assert "rate_hz must be between 0.1 and 100000 Hz" in refusal(PointFiles, str(tmp_path), rate_hz=rate)
    assert check_rate("a.bvh", 30.0) == 30.0


@pytest.mark.parametrize("name", ["none", "\x00", "folder"])
def test_a_path_without_a_regular_file_is_rejected(tmp_path, name):
    (tmp_path / "folder").mkdir()
    assert name in refusal(check_file, tmp_path / name)


def test_implausible_limbs_and_motions_are_rejected(tmp_path, monkeypatch):
    assert f"at most {LONGEST_LIMB_M} m" in refusal(from_height, 1.7, thigh=1.6)
    (subject,) = subjects(1, np.random.default_rng(0))
    write_bandai_like(tmp_path / "a.bvh", walker(subject, 0.2, 30.0))
    sources.load_motion(tmp_path / "a.bvh")
    monkeypatch.setattr("workbench.motion.retarget.MAX_RESIDUAL_MM", 1e-3)
    assert "expected at most 0.001 mm" in refusal(sources.load_motion, tmp_path / "a.bvh")


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("inference.n_particles", MAX_COUNT + 1), ("dataset.n_frames", 10**9), ("seed", 10**400),
        ("a.n_points", 10**8), ("dataset.focal_px", 1e308), ("dataset.focal_px", -1e308), ("dataset.person_px", np.inf),
        ("likelihood.sigma", np.nan), ("prior.sigma", 1e10), ("inference.max_points", 10**10),
        ("dataset.n_frames", 0), ("inference.n_particles", -3), ("likelihood.terms.a.n_particles", 0),
        pytest.param("seed", 1 << 20_000, id="more digits than Python prints"),
    ],
)  # fmt: skip
def test_numbers_out_of_range_are_rejected_with_their_key(place, value):
    """As single values and in lists."""
    for entry in (value, [1, value]):
        config = entry
        for key in reversed(place.split(".")):
            config = {key: config}
        assert refusal(check_sizes, config).startswith(f"config: {place}: expected a number of ")


@pytest.mark.parametrize("convert", [str, str.encode])
@pytest.mark.parametrize(("text", "n_excess"), [("[[], {}, 1, 2]", 0), ("[[], {}, []]", 1), ("[[], {}, 1, 2, 3]", 1)])
def test_json_of_too_many_values_is_refused_before_it_is_parsed(monkeypatch, text, n_excess, convert):
    monkeypatch.setattr(input_limits, "MAX_CONTAINERS", 3)
    monkeypatch.setattr(input_limits, "MAX_ITEMS", 4)
    if n_excess:
        refusal(parse_json, "a.json", convert(text))
    else:
        assert parse_json("a.json", convert(text)) == [[], {}, 1, 2]
