"""Whatever the limits, deviations, velocities and time steps: no draw of the smooth prior leaves its limits."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.skeleton import POSE_NAMES
from workbench.priors.smooth import Smooth, truncated_normal

NAMES = ("root_heading", "left_knee_flexion")
finite = st.floats(-50.0, 50.0)
limits = st.tuples(finite, st.floats(1e-6, 10.0)).map(lambda pair: [pair[0], pair[0] + pair[1]])
deviations = st.floats(0.0, 100.0)


@settings(deadline=None, max_examples=60)
@given(
    a=limits, b=limits, sigma=deviations, sigma_velocity=deviations, pose=finite,
    dt_s=st.floats(0.0, 2.0), seed=st.integers(0, 10**6),
)  # fmt: skip
def test_no_draw_leaves_the_limits(a, b, sigma, sigma_velocity, pose, dt_s, seed):
    prior = Smooth(
        parameters=NAMES,
        lowest=dict(zip(NAMES, (a[0], b[0]), strict=True)),
        highest=dict(zip(NAMES, (a[1], b[1]), strict=True)),
        sigma=dict.fromkeys(NAMES, sigma),
        sigma_velocity=dict.fromkeys(NAMES, sigma_velocity),
        start_uniform=["root_heading"],
    )
    rng = np.random.default_rng(seed)
    state = prior.start(np.full(len(POSE_NAMES), pose), 30, rng)
    for _ in range(3):
        assert np.isfinite(state).all()
        for i, (low, high) in enumerate((a, b)):
            assert ((low <= state[:, i]) & (state[:, i] <= high)).all()
        state = prior.step(state, dt_s, rng)


@settings(deadline=None, max_examples=200)
@given(
    mean=st.floats(-1e12, 1e12), deviation=st.floats(0.0, 1e9), ends=limits,
    u=st.lists(st.floats(2.0**-53, 1.0 - 2.0**-53), min_size=2, max_size=20),
)  # fmt: skip
def test_quantiles_are_ordered_and_inside(mean, deviation, ends, u):
    low, high = ends
    draws = truncated_normal(np.float64(mean), deviation, low, high, np.sort(u))
    assert (low <= draws).all()
    assert (draws <= high).all()
    # rounding may swap neighbours by the precision of mean + deviation·z
    assert (np.diff(draws) >= -4e-16 * (abs(mean) + 50.0 + 40.0 * deviation)).all()


@settings(deadline=None, max_examples=100)
@given(mean=finite, deviation=st.floats(1e-3, 10.0), ends=limits, u=st.floats(1e-6, 1.0 - 1e-6))
def test_mirrored_limits_give_mirrored_quantiles(mean, deviation, ends, u):
    low, high = ends
    draw = truncated_normal(np.array([mean]), deviation, low, high, np.array([u]))
    mirrored = truncated_normal(np.array([-mean]), deviation, -high, -low, np.array([1.0 - u]))
    assert np.allclose(draw, -mirrored, rtol=0.0, atol=1e-8 * (high - low) + 1e-13 * (abs(mean) + deviation))
