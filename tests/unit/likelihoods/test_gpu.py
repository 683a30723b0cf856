"""Cues judged on a GPU: what the processor finds, played by numba's simulator and, where there is one, by a GPU."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gpu_scene
import likelihood_scenes as scenes
import numpy as np
import pytest
from numba import cuda

from workbench.errors import InputError
from workbench.likelihoods.edges.filters import Smoothed, _smoothed, filtered
from workbench.likelihoods.limb_looks import LimbLook, evaluate_together
from workbench.likelihoods.product import Product
from workbench.likelihoods.uniform import Uniform

HAS_GPU = cuda.is_available()


@pytest.fixture(scope="module", params=["simulated", "real"])
def found(request):
    """What the GPU finds of the small scene."""
    if request.param == "real" and not HAS_GPU:
        pytest.skip("no NVIDIA GPU at hand")
    script = Path(gpu_scene.__file__)
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": str(int(request.param == "simulated"))}
    environment["PYTHONPATH"] = os.pathsep.join([str(script.parent), str(script.parents[2])])
    run = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr[-2000:]
    return json.loads(run.stdout)


@pytest.mark.slow
def test_a_gpu_finds_what_the_processor_finds(found):
    looks, poses = gpu_scene.looks(), gpu_scene.poses()
    for look, reference, (log_prob, notes) in zip(
        looks, evaluate_together(looks, poses), found["together"], strict=True
    ):
        np.testing.assert_allclose(log_prob, reference.log_prob, rtol=1e-5, atol=2e-4, err_msg=look.name)
        assert tuple(notes) == reference.notes == (f"{look.name}: 1 of 13 poses were not finite",)
        assert np.ptp(reference.log_prob[5:]) > 0.5  # it depends on the pose


@pytest.mark.slow
def test_neither_other_cues_nor_chunks_change_a_bit(found):
    assert found["together"] == found["alone, in chunks"]


@pytest.mark.slow
def test_filters_respond_on_a_gpu_as_on_the_processor(found):
    grey = gpu_scene.grey()
    smoothed: Smoothed = _smoothed(grey, (0, 0, grey.shape[1], grey.shape[0]))
    expected = filtered(smoothed)
    for values, reference in zip(found["filtered"], (expected.gradient, expected.ridges), strict=True):
        np.testing.assert_allclose(values, reference.ravel(), atol=1e-3)
        assert np.abs(reference).max() > 0.3


def test_another_device_is_refused():
    with pytest.raises(InputError, match="likelihood: device must be one of cpu, gpu, found 'tpu'"):
        Product({"one": Uniform()}, {"one": 1.0}, device="tpu")


@pytest.mark.skipif(HAS_GPU, reason="there is an NVIDIA GPU at hand")
def test_without_a_gpu_it_is_refused():
    with pytest.raises(InputError, match="device=gpu needs an NVIDIA GPU, its driver and the extra `gpu`"):
        Product({"one": Uniform()}, {"one": 1.0}, device="gpu")


def test_cues_that_have_no_kernel_there_are_refused_when_they_first_look(monkeypatch):
    from workbench.likelihoods.gpu import looks

    monkeypatch.setattr(looks, "check_gpu", lambda: None)
    product = Product({"flat": Uniform(), "off": Uniform()}, {"flat": 1.0, "off": 0.0}, device="gpu")
    with pytest.raises(InputError, match="appearance, edges and silhouette alone, found flat; give it the weight 0"):
        product.look(None, None)
    looks.check_looks({look.name: look for look in gpu_scene.looks()})


def test_a_body_of_more_limbs_than_there_is_room_for_is_refused():
    from workbench.likelihoods.gpu import cues, looks

    rods = [((0.0, 0.0, 0.1 * k), (0.0, 0.0, 0.1 * k + 0.1), 0.02) for k in range(cues.MOST_LIMBS + 1)]
    look = LimbLook("edges", scenes.rods(*rods), [], lambda expected_pose: None)
    with pytest.raises(InputError, match="on a GPU bodies may have 34 limbs, this one has 35"):
        looks.evaluate_on_gpu([look], np.zeros((1, 25)))
    room = 4 * cues.PARTICLES * cues.MOST_LIMBS * cues.LIMB + cues.PARTICLES * (12 * cues.MOST_LIMBS + 12 * cues.WARP)
    assert room <= 48 * 1024
