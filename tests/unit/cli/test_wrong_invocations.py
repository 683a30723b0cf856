"""Sixty things that a person types wrongly: each ends with code 2 and one sentence, none with a traceback."""

import sys

import pytest
from hydra.core.global_hydra import GlobalHydra

from workbench.cli import check, export, report, run, runs, view

MAIN = (
    "dataset=video", "dataset=multi_view", "dataset=point_files", "body=height", "body=file",
    "dataset=video body=height experiment=custom", "dataset=multi_view body=keypoints experiment=custom",
    "dataset=point_files dataset.source=nowhere", "dataset=video dataset.source=x.mp4",
    "dataset=video dataset.source=x.mp4 dataset.camera=c.toml experiment=custom body=height body.height_m=1.7",
    "dataset=blink", "prior=walkin", "prior=schema_walking", "dataset=schema_video", "likelihood=none",
    "inference=particlefilter", "experiment=walk_strait", "experiment=track_vidoe", "paper=literally", "body=tall",
    "inference.n_particle=100", "likelihood.sigm=3", "sed=3", "dataset.n_frame=3", "prior.sigma=1",
    "inference.n_particles=many", "inference.n_particles=-3", "inference.n_particles=0", "seed=one", "seed=-1",
    "threads=0", "threads=100000", "dataset.n_frames=0", "dataset.n_frames=-5", "dataset.motion=nobody",
    "dataset.motion=file.bvh", "experiment=walk_video", "experiment=balance_4cam", "experiment=walk_keypoints",
    "experiment=temperature", "learn.motions=nothing.h5", "dataset.view_deg=left", "=3", "seed", "seed=", "n_particles",
    "+prior.new_key=3",
    "++inference.what=1", "~prior", "~seed", "prior=[walking", "'seed=3", "--bogus", "-x", "--seed 3",
    "from=nowhere.rrd", "from=nowhere.rrd@12 seed=1", "parts=[no_such_package]", "parts=no_such_package",
    "study=nothing", "inference=hybrid likelihood=image_motion", "likelihood=keypoints",
    "dataset=blank", "dataset=points likelihood=image_motion", "inference=least_squares",
)  # fmt: skip
OTHERS = (
    (view, "nowhere.rrd"), (view, "."), (report, "nowhere"), (check, "nowhere.rrd"), (check, "nowhere.rrd inference=x"),
    (check, "--seeds 1 nowhere.rrd"), (runs, "list --view many"), (export, "nowhere.rrd walk.bvh"),
)  # fmt: skip


@pytest.fixture(autouse=True)
def _apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    yield
    GlobalHydra.instance().clear()


def _ends(call):
    """The exit code of a command, however it ends."""
    try:
        return call()
    except SystemExit as ended:
        return ended.code


def _one_sentence(code, told):
    assert code == 2, told
    assert "Traceback" not in told
    assert told.strip(), "nothing is said"


@pytest.mark.slow
@pytest.mark.parametrize("words", MAIN)
def test_the_main_command_says_a_sentence(words, monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["workbench", *words.split()])
    code = _ends(run.main)
    _one_sentence(code, capfd.readouterr().err)


@pytest.mark.parametrize(("command", "words"), OTHERS)
def test_the_other_commands_say_a_sentence(command, words, capfd):
    code = _ends(lambda: command.main(words.split()))
    _one_sentence(code, capfd.readouterr().err)
