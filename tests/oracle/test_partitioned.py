"""Partitioned sampling against the exact posterior and evidence of a linear Gaussian model, a column being a part."""

import numpy as np
import pytest
from linear_gaussian import MEAN0, LinearPrior, Position, exact, frames, moments, simulate, streams

from workbench.errors import InputError
from workbench.inference.particle_filter import ParticleFilter
from workbench.inference.partitioned import PARTS, Partitioned, columns_of_parts
from workbench.learning.training import walking_model
from workbench.priors.cyclic import Cyclic
from workbench.priors.jitter import Jitter
from workbench.priors.mixture import Mixture
from workbench.priors.smooth import Smooth
from workbench.priors.state import StateSpace

T, SEEDS, N = 10, 30, 200


class TwoJoints(LinearPrior):
    """The columns called after joints, so that they are of two parts of the body."""

    space = StateSpace.of({"legs": (("left_knee_flexion",), "rad"), "arms": (("left_elbow_flexion",), "rad")})


def runs(make, measured, n_seeds=SEEDS, **model):
    """Of the last frame: mean, variance and log evidence (n_seeds, 5); effective sample sizes over all frames."""
    found, sizes = [], []
    for seed in range(n_seeds):
        steps = list(make(TwoJoints(), Position(measured, **model)).run(frames(T), MEAN0, streams(seed)))
        found.append([*np.concatenate(moments(steps[-1])), steps[-1].log_evidence])
        sizes += [step.ess / len(step.particles) for step in steps[1:]]
    return np.array(found), float(np.mean(sizes))


@pytest.mark.parametrize(
    ("flatten", "parts"), [(0.7, ["lower_body", "upper_body"]), (1.0, ["upper_body", "lower_body"])]
)
def test_converges_to_the_exact_posterior_and_evidence(flatten, parts):
    """Within 5 standard errors; the log of an unbiased estimate is too low by half its variance, which is about ten
    times a variance over N, as are the variances' own biases."""
    model = {"sigma": 0.1, "g": 1.0, "h": -0.5}
    measured = simulate(T, seed=3, sigma=0.1, h=-0.5)
    mean, variance, evidence = exact(measured, **model)
    found, _ = runs(lambda p, y: Partitioned(p, y, n_particles=N, flatten=flatten, parts=parts), measured, **model)
    expected = np.array([*mean[-1], *variance[-1], evidence])
    deviation = found.std(axis=0)
    bias = np.array([0.0, 0.0, *(10.0 * variance[-1] / N), 0.5 * deviation[4] ** 2 + 10.0 / N])
    assert (np.abs(found.mean(axis=0) - expected) < 5.0 * deviation / np.sqrt(SEEDS) + bias).all()


def test_one_part_that_decides_all_leaves_nothing_to_weigh():
    """Where only the first part is seen, and is trusted fully, every particle ends with the same weight."""
    measured = simulate(T, seed=3)
    make = lambda p, y: Partitioned(p, y, n_particles=50, flatten=1.0, parts=["lower_body", "upper_body"])  # noqa: E731
    assert runs(make, measured, n_seeds=1)[1] == pytest.approx(1.0)


class Each:
    """Every angle is measured alike: N(0, 0.05²)."""

    def log_prob(self, previous, frame, previous_pose, pose):
        return -0.5 * ((pose[:, 6:] / 0.05) ** 2).sum(axis=1)

    def warnings(self):
        return ()


def test_part_by_part_more_particles_count_for_the_same_evaluations():
    """Of six angles, each of which leaves a share r of the particles, r^6 are left at once, r^3 in two parts."""
    prior = Smooth(parameters=["left_arm", "left_hip_flexion", "left_knee_flexion"])
    pose, sizes = np.zeros(25), {}
    for name, inference in (
        ("at once", ParticleFilter(prior, Each(), n_particles=1000)),
        ("in parts", Partitioned(prior, Each(), n_particles=500, parts=["lower_body", "upper_body"])),
    ):
        steps = list(inference.run(frames(4), pose, streams(0)))
        assert sum(step.evaluations for step in steps) == 3000
        sizes[name] = np.mean([step.ess for step in steps[1:]])
    assert sizes["in parts"] > 2.0 * sizes["at once"]


def test_columns_go_with_their_parameter_and_the_rest_with_the_first_part(tmp_path):
    base = Cyclic(walking_model(motions="builtin", cache=str(tmp_path), n_components=3))
    for prior in (Jitter(base), Smooth()):
        columns = columns_of_parts(prior.space, PARTS)
        assert sorted(np.concatenate(columns)) == list(range(len(prior.space)))
        names = [{prior.space.names[i] for i in part} for part in columns]
        assert all("hip" in name or "knee" in name for name in names[1])
        assert all("shoulder" in name or "elbow" in name or "neck" in name for name in names[2])
        assert len(names[1]) == (8 if prior.space.names[0] == "c1" else 16)


def test_what_cannot_be_parted_is_named(tmp_path):
    with pytest.raises(InputError, match="all of which are in one part"):
        Partitioned(Cyclic(walking_model(motions="builtin", cache=str(tmp_path), n_components=3)), None)
    with pytest.raises(InputError, match="tail"):
        Partitioned(Smooth(), None, parts=["root", "tail"])
    with pytest.raises(InputError, match="flatten"):
        Partitioned(Smooth(), None, flatten=2.0)
    with pytest.raises(InputError, match="can only be drawn from"):
        Partitioned(Mixture({"a": Smooth()}, {"a": 1.0}), None)
