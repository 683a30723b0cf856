"""What a run's likelihood takes longest to compile is begun at once, and nothing else."""

from importlib import import_module
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from workbench.experiment import compiling_ahead


@pytest.fixture
def begun(monkeypatch):
    """The modules by which something is to be compiled beside the run, which nothing is."""
    modules = []
    monkeypatch.setattr(compiling_ahead, "compile_beside", lambda *kernels, by: modules.append(by))
    return modules


INFERENCE = {
    "_target_": "workbench.inference.particles.filter.ParticleFilter",
    "move": {"_target_": "workbench.inference.particles.bootstrap.Bootstrap"},
}
MOTION, EDGES, KEYPOINTS, ALIGNMENT = (
    {"_target_": f"workbench.likelihoods.{name}"}
    for name in (
        "image_motion.ImageMotion",
        "edges.Edges",
        "keypoints.KeypointLikelihood",
        "alignment.alignment.Alignment",
    )
)


def product(**weights):
    terms = {"image_motion": MOTION, "edges": EDGES, "keypoints": KEYPOINTS}
    return {"_target_": "workbench.likelihoods.product.Product", "terms": terms, "weights": weights}


@pytest.mark.parametrize(
    ("likelihood", "modules"),
    [
        (MOTION, ["image_motion.kernel"]),
        (EDGES, ["limb_points"]),
        (ALIGNMENT, ["limb_points", "alignment.kernels", "alignment.layers"]),
        (KEYPOINTS, []),
        (None, []),
        (product(image_motion=0.0, edges=1.0, keypoints=1.0), ["limb_points"]),
        (product(image_motion=0.5, edges=0.5, keypoints=0.0), ["image_motion.kernel", "limb_points"]),
    ],
)
def test_what_is_compiled_ahead_is_what_the_likelihood_calls(begun, likelihood, modules):
    compiling_ahead.compile_ahead(OmegaConf.create({"likelihood": likelihood, "inference": INFERENCE}))
    assert begun == [f"workbench.likelihoods.{module}" for module in modules]


def test_nothing_is_compiled_ahead_for_an_inference_that_looks_at_no_likelihood(begun):
    synthesis = {"_target_": "workbench.inference.synthesis.Synthesis"}
    compiling_ahead.compile_ahead(OmegaConf.create({"likelihood": MOTION, "inference": synthesis}))
    assert begun == []


def test_every_kernel_that_is_compiled_ahead_is_one_and_every_likelihood_an_option():
    options = {OmegaConf.load(path)["_target_"] for path in Path("conf/likelihood").glob("*.yaml")}
    assert set(compiling_ahead._SLOW) <= options
    for (module, *kernels), by in (each for processes in compiling_ahead._SLOW.values() for each in processes):
        assert all(hasattr(getattr(import_module(module), kernel), "stats") for kernel in kernels)  # as numba's have
        assert callable(import_module(by).compile_ahead)
