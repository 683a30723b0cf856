"""A run that branches off a recorded one: its configuration, but for what was said."""

import json

import pytest

from workbench.recording.read.reader import read

SMALL = ("dataset.n_frames=3", "inference.n_particles=40", "dataset.width=80", "dataset.height=60")
SMALL += ("dataset.person_px=40", "dataset.focal_px=90", "likelihood.k=0.7")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def first(run):
    code, told, folder = run("first", "experiment=walk_circle", *SMALL)
    assert code == 0, told
    return folder / "run.rrd"


def test_unchanged_it_gives_the_same_bits(run, first):
    code, told, folder = run("second", f"from={first}")
    assert code == 0, told
    assert "→" not in told
    assert (read(first).poses[1] == read(folder / "run.rrd").poses[1]).all()


def test_what_differs_is_said_and_the_parent_is_kept(run, first):
    code, told, folder = run("second", f"from={first}", "seed=3", "inference.n_particles=50")
    assert code == 0, told
    assert "seed: 0 → 3\n" in told
    assert "inference.n_particles: 40 → 50\n" in told
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["experiment"] == "walk_circle"
    assert summary["settings"]["likelihood"]["k"] == 0.7
    parent = read(first).properties["run"]["id"]
    assert summary["provenance"]["parent"] == read(folder / "run.rrd").provenance["parent"] == parent


def test_another_part_is_the_experiments_own(run, first):
    code, told, folder = run("second", f"from={first}", "prior=smooth", "prior.damping=2")
    assert code == 0, told
    settings = read(folder / "run.rrd").settings
    assert settings["prior"]["_target_"].endswith("Smooth")
    assert settings["prior"]["damping"] == 2
    assert settings["inference"]["n_particles"] == 40
    code, _, third = run("third", f"from={folder / 'run.rrd'}", "prior=walking")
    assert code == 0
    assert read(third / "run.rrd").settings["prior"] == read(first).settings["prior"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["prior=smoth"], "smoth"),
        (["inference.n_particle=3"], "n_particle"),
        (["-m", "seed=1,2"], "starts one run"),
        (["dataset._target_=os.system"], "_target_"),
    ],
)
def test_what_cannot_be_changed_is_a_sentence(run, first, words, told):
    done = run("second", f"from={first}", *words)
    assert done.code == 2
    last = done.err.strip().splitlines()[-1]  # before it may stand what Hydra's handlers of the first run complain of
    assert last.startswith("workbench: ")
    assert told in last
    assert not (done.folder / "run.rrd").exists()


def test_a_recording_that_is_not_there_is_a_sentence(run):
    done = run("second", "from=nothing.rrd")
    assert (done.code, done.err.count("\n")) == (2, 1)
