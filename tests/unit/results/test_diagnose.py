"""The changes of a run that a diagnosis tests, and its conclusion from the repetitions."""

from types import SimpleNamespace

import numpy as np
import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from workbench.experiment.config.schema import prepare_hydra
from workbench.results import diagnose
from workbench.results.diagnose import SAME, Change, Outcome, changes_of, conclusion
from workbench.utils.errors import InputError

BODY = Change("the true body")


def changes(*overrides):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=["experiment=custom", *overrides, "paths.data=null"])
    return {change.name: change for change in changes_of(OmegaConf.to_container(config, resolve=True))}


def test_every_change_is_of_one_component_or_parameter():
    perturbations = "dataset.perturbations={camera_deg:2.0,start_m:0.0,start_rad:0.0,lengths:0.0,radii:0.0,profile:0.0}"
    overrides = ("prior=walking", "likelihood=product", "dataset.occluder=true", "body.scale=1.2", perturbations)
    tested = changes("dataset=synthetic", *overrides)
    assert list(tested) == [
        "4 times the particles", "without image_motion", "without background", "without appearance", "without edges",
        "prior=smooth", "prior=ar_offsets", "without the occluder", "the true body", "without perturbation clothes_m",
        "without perturbation camera", "without perturbation camera_deg",
    ]  # fmt: skip
    assert tested["without edges"] == Change("without edges", ("likelihood.weights.edges=0.0",))
    assert tested["the true body"] == Change("the true body", ("body.scale=1.0",))
    (override,) = tested["without perturbation camera"].overrides
    sizes = OmegaConf.from_dotlist([override.replace(":", ": ")]).dataset.perturbations
    assert (sizes.camera, sizes.camera_deg, sizes.clothes_m) == (0.0, 2.0, 0.005)


def test_inapplicable_changes_are_omitted():
    tested = changes("dataset=synthetic", "prior=smooth", "likelihood=image_motion", "dataset.perturb=false")
    assert list(tested) == ["4 times the particles", "prior=ar_offsets"]


@pytest.mark.parametrize(("n_tracked", "p"), [(0, "0.004"), (4, "0.5")])  # 1/C(10, 5), C(9, 4)/C(10, 5)
def test_a_change_is_compared_with_another_seed(n_tracked, p):
    text = conclusion([Outcome(BODY, 5, 5, 0.3), Outcome(SAME, n_tracked, 5, 1.0)])
    assert f"with which 5 of 5 runs keep the track, with only another seed {n_tracked} of 5" in text
    assert f"(p = {p}" in text


@pytest.mark.parametrize("n_tracked", [3, 5])
def test_a_change_no_better_than_another_seed_is_no_cause(n_tracked):
    outcomes = [Outcome(BODY, n_tracked, 5, 0.3), Outcome(SAME, n_tracked, 5, 0.5)]
    assert conclusion(outcomes).startswith("no cause")


def test_without_states_annotated_frames_decide_whether_the_track_is_near():
    run = SimpleNamespace(metric=lambda name: (np.array([2, 20, 30, 60]), np.array([1.0, 30.0, 50.0, 1.0])))
    is_near = [diagnose._is_near(run, 25, {"mpjpe_px": error}) for error in (19.0, 21.0)]
    assert is_near == [True, False]
    assert not diagnose._is_near(run, 45, {"mpjpe_px": 0.0})


def test_a_run_without_truth_and_observations_is_rejected(monkeypatch):
    monkeypatch.setattr(diagnose, "cells", lambda path, contents: {})
    assert diagnose.lost_frames(SimpleNamespace(path="run.rrd", metrics={"mpjpe_px": None})) == []
    with pytest.raises(InputError, match=r"run\.rrd: expected ground truth, keypoints or annotated frames"):
        diagnose.lost_frames(SimpleNamespace(path="run.rrd", metrics={}))
