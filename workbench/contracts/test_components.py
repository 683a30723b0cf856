"""Contract tests: every option of a package composes, runs, and satisfies the contract of its group."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hydra import compose, initialize_config_module
from omegaconf import DictConfig

from workbench.core.capabilities import DENSITY, KEYPOINTS, MOTION, POINTS, RESIDUALS, Traits
from workbench.core.prior import propose
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.options import GROUPS, allow_packages, options
from workbench.experiment.config.requirements import traits_of
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.tracking import Components, assemble, track
from workbench.utils.arrays import FloatArray

N_FRAMES, N = 4, 30
SMALL = ("width=160", "height=120", "person_px=80.0", "focal_px=175.0", f"n_frames={N_FRAMES}")
SCENE = ("dataset=synthetic", *(f"dataset.{text}" for text in SMALL))
BY_REQUIREMENT = {
    POINTS: ("dataset=points", f"dataset.n_frames={N_FRAMES}", "dataset.n_points=80", "likelihood=surface_points"),
    RESIDUALS: ("dataset=points", f"dataset.n_frames={N_FRAMES}", "dataset.n_points=80", "likelihood=surface_points"),
    KEYPOINTS: (*SCENE, "dataset.keypoint_sigma_px=2.0", "likelihood=keypoints"),
}
"""Overrides for components that require more than images."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Test every option of the package that --component-package names."""
    package = metafunc.config.getoption("--component-package")
    pairs: list[tuple[str, str]] = []
    if package:
        allow_packages([package])
        pairs = [(group, name) for group in GROUPS for name, item in options(group).items() if item.package == package]
    tested = next((group for group in GROUPS if metafunc.function.__name__.startswith(f"test_a_{group}_")), None)
    metafunc.parametrize(("group", "option"), [pair for pair in pairs if tested in (None, pair[0])])


@pytest.fixture(autouse=True)
def hydra_is_ready() -> Iterator[None]:
    """Initialize Hydra with the options of the package and the workbench."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        yield


def composed(group: str, option: str, cache: str, *overrides: str) -> DictConfig:
    """Return the configuration of a small run with the option and its requirements."""
    chosen = [] if group in ("experiment", "study") else [f"{group}={option}"]
    common = ["experiment=custom", f"paths.cache={cache}", "paths.data=null"]
    single = compose("config", overrides=[*common, *chosen])
    traits = traits_of(single[group]) if single[group] is not None else Traits()
    words = {word for words in traits.requires.values() for word in words}
    scene = next((scene for word, scene in BY_REQUIREMENT.items() if word in words), SCENE)
    scene = tuple(text for text in scene if not text.startswith(f"{group}") or group != "dataset")
    config = compose("config", overrides=[*common, *scene, *chosen, *overrides])
    if "n_particles" in config.inference:
        config.inference.n_particles = N
    return config


def assembled(group: str, option: str, cache: str) -> Components:
    """Return the components of a small run."""
    return assemble(composed(group, option, cache))


def start_of(components: Components) -> FloatArray:
    """Return an initial pose (P,)."""
    assert components.start is not None
    return np.atleast_2d(components.start)[0]


def test_line_1_names_the_class(group: str, option: str) -> None:
    assert options(group)[option].target is not None


def test_a_typo_names_the_key(group: str, option: str, tmp_path: Any) -> None:
    with pytest.raises(Exception, match="no_such_key"):
        composed(group, option, str(tmp_path), f"{group}.no_such_key=1")


def test_a_run_is_complete_and_repeatable(group: str, option: str, tmp_path: Any) -> None:
    if group in ("study", "recorder"):
        pytest.skip(f"a {group} does not track")
    runs = [[step for step, _ in track(assembled(group, option, str(tmp_path)), seed=3)] for _ in range(2)]
    assert len(runs[0]) == len(runs[1]) > 0
    for first, second in zip(*runs, strict=True):
        assert first.particles.shape[1] == len(first.space) == len(first.space.units)
        assert np.exp(first.log_weights).sum() == pytest.approx(1.0)
        assert np.isfinite(first.expected_pose).all()
        np.testing.assert_array_equal(first.particles, second.particles)
        np.testing.assert_array_equal(first.log_weights, second.log_weights)


def test_a_prior_samples_and_decodes(group: str, option: str, tmp_path: Any) -> None:
    components = assembled(group, option, str(tmp_path))
    prior, rng = components.prior, np.random.default_rng(0)
    assert prior is not None
    provided = traits_of(composed(group, option, str(tmp_path)).prior).provides
    assert (DENSITY in provided) <= (prior.capabilities.density is not None)  # else inferences fail that require it
    assert (MOTION in provided) <= (prior.capabilities.motion is not None)
    pose = start_of(components)
    state = prior.sample_initial(pose, N, rng)
    before = state.copy()
    moved, correction = propose(prior, state, 1.0 / 30.0, rng)
    np.testing.assert_array_equal(state, before)  # the input states are unchanged
    assert state.shape == moved.shape == (N, len(prior.space))
    assert correction.shape == (N,)
    assert prior.pose(moved).shape == (N, len(pose))
    assert set(prior.parameters) <= set(components.body.skeleton.dof_names)
    if (density := prior.capabilities.density) is not None:
        sampled = prior.sample_transition(state, 1.0 / 30.0, rng)
        assert np.isfinite(density.log_transition(state, sampled, 1.0 / 30.0)).all()
        completed = density.sample_dependent(state, sampled, 1.0 / 30.0, rng)
        np.testing.assert_array_equal(completed[:, density.free], sampled[:, density.free])


def test_a_likelihood_evaluates_each_pose_independently(group: str, option: str, tmp_path: Any) -> None:
    components, config = assembled(group, option, str(tmp_path)), composed(group, option, str(tmp_path))
    likelihood = build(config.likelihood, body=components.body, clip=components.clip, info=components.clip.info)
    first, second, *_ = components.clip
    rng = np.random.default_rng(0)
    poses = start_of(components) + 0.02 * rng.standard_normal((N, len(components.body.skeleton.dof_names)))
    assert (RESIDUALS in traits_of(config.likelihood).provides) <= hasattr(likelihood, "residual_function")
    info = likelihood.prepare(None, first).update(poses.mean(axis=0))
    log_prob, repeated = (info.prepare(first, second).evaluate(poses, poses).log_prob for _ in range(2))
    assert log_prob.shape == (N,)
    np.testing.assert_array_equal(log_prob, repeated)
    order = rng.permutation(N)
    shuffled = info.prepare(first, second).evaluate(poses[order], poses[order]).log_prob
    np.testing.assert_allclose(shuffled, log_prob[order], rtol=1e-6)


def test_a_dataset_has_frames_as_its_info_states(group: str, option: str, tmp_path: Any) -> None:
    dataset = build(composed(group, option, str(tmp_path)).dataset)
    frames, info = list(dataset.frames()), dataset.info
    assert len(frames) == info.n_frames > 0
    assert all(later.time_s > sooner.time_s for sooner, later in pairwise(frames))
    assert all(view.image.shape[:2] == (view.camera.height, view.camera.width) for f in frames for view in f.views)
    assert info.has_points == any(frame.points is not None for frame in frames)
