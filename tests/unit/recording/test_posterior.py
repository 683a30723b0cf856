"""What a recording shows of the posterior: only what is estimated, and first what moves."""

import numpy as np
import pytest

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import PARTS, POSE_NAMES
from workbench.core.frame import Frame
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.uniform import Uniform
from workbench.motion.models.walking import learn_walking
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.cyclic import Cyclic
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth
from workbench.recording.read.reader import read
from workbench.recording.write.posterior import Posterior
from workbench.recording.write.recorder import Recorder

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
    collected = Posterior(prior.space, BODY.skeleton, None, N_BINS)
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
    collected = Posterior(prior.space, BODY.skeleton, None, N_BINS)
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
        assert {*favourites} <= {*Posterior(prior.space, BODY.skeleton, None, N_BINS).names}


def test_a_recording_of_an_arm_has_marginals_of_the_arm(priors, tmp_path):
    """The property `marginals` names the rows of the tensor."""
    prior = priors["arm"]
    path = tmp_path / "run.rrd"
    with Recorder(path, BODY, prior.space, run_id="r", config_yaml="", provenance={}, marginal_bins=N_BINS) as recorder:
        for step in steps(prior):
            recorder.log(step, {})
    found = read(path)
    assert found.marginals.names == posterior(prior, steps(prior)).names
    assert found.marginals.log_mass.shape == (len(found.marginals.names), N_BINS, N_FRAMES)
    recorded = {path.split("/")[2] for path in found.scalars if path.startswith("posterior/parameters/")}
    assert recorded == {*found.marginals.names}
