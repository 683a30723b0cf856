"""What a recording shows of the posterior: only what is estimated, and first what moves."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import recording_steps
import rerun as rr
from recorded import record, static

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import PARTS, POSE_NAMES
from workbench.core.frame import Frame
from workbench.evaluation.intervals import weighted_quantiles
from workbench.evaluation.posterior_calibration import ranks, share_below
from workbench.evaluation.step_calibration import pose_ranks
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.uniform import Uniform
from workbench.motion.models.walking import learn_walking
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.cyclic import Cyclic
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth
from workbench.recording.read.reader import read
from workbench.recording.write.marginals import LOWEST_LOG_MASS
from workbench.recording.write.posterior import RANKS, Posterior, marginal_picture

BODY = person(from_height(1.75))
N_FRAMES, N_BINS = 4, 16
LEGS = ("left_hip_flexion", "right_hip_flexion", "left_knee_flexion", "right_knee_flexion")
ARM = PARTS["right_arm"]


def steps(prior, n_particles=40):
    frames = [Frame(index=t, time_s=t / 30, views=()) for t in range(N_FRAMES)]
    streams = {name: np.random.default_rng(k) for k, name in enumerate(("start", "resampling", "prior"))}
    start = builtin_motions()[0].poses[0]
    return list(ParticleFilter(prior, Uniform(), n_particles=n_particles).run(frames, start, streams))


def posterior(prior, taken):
    collected = Posterior(prior.space, BODY.skeleton, N_BINS)
    for step in taken:
        collected.add(step)
    return collected


@pytest.fixture(scope="module")
def priors():
    arm, walk = (
        Smooth(parameters=["right_arm"]),
        Cyclic(learn_walking(builtin_motions(), variance=0.95, n_components=4, scaling="none")),
    )
    arm_windows = learn_windows(builtin_motions(n_subjects=2), angles=["right_arm"], root=False)
    return {
        "walk": walk,
        "smooth": Smooth(),
        "arm": arm,
        "database": Implicit(learn_windows(builtin_motions(n_subjects=2))),
        "arm database": Implicit(arm_windows),
    }


def test_held_columns_are_left_out(priors):
    prior = priors["arm"]
    collected = posterior(prior, steps(prior))
    velocities = tuple(f"{name}_velocity" for name in ARM)
    assert collected.names == (*ARM, *velocities)
    assert collected.units[:8] == ("rad",) * 4 + ("rad/s",) * 4


@pytest.mark.parametrize("name", ["database", "arm database"])
def test_memory_ahead_is_left_out(priors, name):
    prior = priors[name]
    b = len(prior.windows.sigmas)
    expected = (*POSE_NAMES, *(f"c{k + 1}" for k in range(b)))
    assert posterior(prior, steps(prior)).names == expected
    assert len(prior.space) == len(expected) + b * (prior.windows.length - 1)  # there is such memory


@pytest.mark.parametrize("name", ["walk", "smooth", "arm", "database", "arm database"])
def test_names_units_bands_and_marginals_belong_together(priors, name):
    """Each parameter's marginal and band are those of the column of its name, or of the pose's angle."""
    prior = priors[name]
    taken = steps(prior)
    collected = Posterior(prior.space, BODY.skeleton, N_BINS)
    numbers = [collected.add(step) for step in taken]
    entities, axes = collected.pictures()
    log_mass = dict(entities)["posterior/marginals"].data.as_arrow_array().to_pylist()[0]["buffer"]
    log_mass = np.array(log_mass, dtype=float).reshape(-1, N_BINS, N_FRAMES)
    assert len(axes["names"]) == len(axes["units"]) == len(axes["low"]) == len(log_mass) == len(collected.names)
    for k, parameter in enumerate(collected.names):
        edges = np.linspace(axes["low"][k], axes["high"][k], N_BINS + 1)
        for t, step in enumerate(taken):
            own = parameter in prior.space.names
            values = step.particles[:, prior.space.names.index(parameter)] if own else step.poses[:, angle(parameter)]
            assert numbers[t][f"posterior/parameters/{parameter}/mean"] == pytest.approx(values.mean(), abs=1e-9)
            mass = np.histogram(values, edges)[0] / len(values)
            # a value on an edge may be counted on either side of it; empty bins show 1e-4
            assert np.abs(np.cumsum(np.exp(log_mass[k, :, t])) - np.cumsum(mass)).max() <= 1 / len(values) + 16e-4


def angle(name):
    return BODY.skeleton.dof(name)


@pytest.mark.parametrize(
    ("name", "favourites"),
    [("walk", LEGS), ("smooth", LEGS), ("database", LEGS),
     ("arm", ARM), ("arm database", ARM)],
)  # fmt: skip
def test_pictured_is_what_moves(priors, name, favourites):
    assert posterior(priors[name], steps(priors[name])).favourites == favourites


def test_one_particle_or_a_start_without_spread_has_pictures_too(priors):
    for prior, n in ((priors["walk"], 1), (priors["arm"], 1), (Smooth(start_pose=0.0), 30)):
        favourites = posterior(prior, steps(prior, n)).favourites
        assert len(favourites) == 4
        assert {*favourites} <= {*Posterior(prior.space, BODY.skeleton, N_BINS).names}


def test_a_recording_of_an_arm_has_marginals_of_the_arm(priors, tmp_path):
    """The property `marginals` names the rows of the tensor."""
    prior = priors["arm"]
    found = read(record(tmp_path / "run.rrd", steps(prior), space=prior.space, marginal_bins=N_BINS))
    assert found.marginals.names == posterior(prior, steps(prior)).names
    assert found.marginals.log_mass.shape == (len(found.marginals.names), N_BINS, N_FRAMES)
    recorded = {path.split("/")[2] for path in found.scalars if path.startswith("posterior/parameters/")}
    assert recorded == {*found.marginals.names}


def uneven(n_particles):
    """A step with Gaussian root_x and uneven weights: its band, values and weights."""
    prior = Smooth()
    first = steps(prior, n_particles)[0]
    rng = np.random.default_rng(4)
    weights = rng.gamma(0.5, size=n_particles)
    particles, k = first.particles.copy(), prior.space.names.index("root_x")
    particles[:, k] = rng.normal(size=n_particles)
    step = replace(first, particles=particles, log_weights=np.log(weights / weights.sum()))
    numbers = Posterior(prior.space, BODY.skeleton, N_BINS).add(step)
    ends = [numbers[f"posterior/parameters/root_x/{row}"] for row in ("low", "high")]
    return ends, particles[:, k], np.exp(step.log_weights)


def test_of_a_thousand_particles_the_bands_are_the_weighted_quantiles():
    ends, values, weights = uneven(1000)
    assert ends == weighted_quantiles(values[:, None], weights, (0.05, 0.95))[:, 0].tolist()


@pytest.mark.parametrize("n_particles", [1001, 5000, 20_000])
def test_of_more_the_weight_beyond_is_five_per_cent_within_the_resampling_error(n_particles):
    (low, high), values, weights = uneven(n_particles)
    beyond = [weights[values < low].sum(), weights[values > high].sum()]
    assert beyond == pytest.approx([0.05, 0.05], abs=4.0 * np.sqrt(0.05 * 0.95 / 1000))  # four standard errors
    assert {low, high} <= {*values.tolist()}


def heights(path, entity):
    found = static(path, entity, "BarChart:values")
    return None if found is None else np.array(found[0]["buffer"])


def test_the_shares_of_all_ranks_after_the_first_frame_are_recorded(tmp_path):
    run = list(recording_steps.steps(6))
    path = record(tmp_path / "run.rrd", run)
    every = np.concatenate(
        [
            ranks(share_below(s.poses, np.exp(s.log_weights), s.frame.truth.pose))[np.ptp(s.poses, axis=0) > 0.0]
            for s in run[1:]
        ]
    )
    assert len(every) >= 5
    expected = np.histogram(every, bins=10, range=(0.0, 1.0))[0] / len(every)
    np.testing.assert_allclose(heights(path, f"/{RANKS}"), expected, rtol=1e-6)
    assert heights(path, f"/{RANKS}/even") == pytest.approx(np.full(10, 0.1))
    blind = [replace(step, frame=replace(step.frame, truth=None)) for step in run[:3]]
    assert all(len(pose_ranks(step)) == 0 for step in blind)
    assert heights(record(tmp_path / "blind.rrd", blind), f"/{RANKS}") is None


def drawn(truth, unit="rad"):
    """{entity below the picture: archetype} of a marginal over 0 to π/2 that is all in the second of four bins."""
    log_mass, frames = np.full((4, 6), LOWEST_LOG_MASS), list(range(10, 16))
    log_mass[1] = 0.0
    entities = marginal_picture("knee", unit, (0.0, np.pi / 2.0), log_mass, frames, np.asarray(truth))
    return {path.rpartition("/")[2]: each for path, each in entities if not isinstance(each, rr.Transform3D)}


def test_in_a_picture_the_truth_lies_on_the_bin_that_holds_it():
    found = drawn(np.full(6, 0.3 * np.pi / 2.0))
    blob = np.asarray(found["mass"].blob.as_arrow_array().to_pylist()[0], dtype=np.uint8)
    rows = cv2.imdecode(blob, cv2.IMREAD_COLOR).sum(axis=2)
    assert rows.shape == (4, 6)
    assert set(rows.argmax(axis=0)) == {2}  # the second from below
    (strip,) = found["truth"].strips.as_arrow_array().to_pylist()
    np.testing.assert_allclose(np.array(strip), [[(k + 0.5) * 320.0 / 6.0, 0.7 * 80.0] for k in range(6)], atol=1e-4)
    gaps = drawn([0.1, 0.1, np.nan, 9.0, 0.2, 0.2])["truth"].strips.as_arrow_array().to_pylist()
    assert [len(strip) for strip in gaps] == [2, 2]  # not where it is unknown or outside


@pytest.mark.parametrize(("unit", "ends"), [("rad", ["90", "0"]), ("m", ["1.57", "0"])])
def test_the_axis_says_its_values(unit, ends):
    labels = drawn(np.zeros(6), unit)["values"].labels.as_arrow_array().to_pylist()
    assert labels == [*ends, "#10", "#15"]
