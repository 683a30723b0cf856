"""Runs that repeat a recording with changes (`from=RUN.rrd key=value`)."""

import json

import pytest

from workbench.cli.main import main
from workbench.recording.read.reader import read
from workbench.recording.write import recorder

SMALL = ("dataset.n_frames=3", "inference.n_particles=40", "dataset.width=80", "dataset.height=60")
SMALL += ("dataset.person_px=40", "dataset.focal_px=90", "likelihood.effective_pixels=0.7")


def record_run(folder, cache, *overrides):
    """Run in a folder and return the recording."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORKBENCH_CACHE", str(cache))
        patch.delenv("WORKBENCH_DATA", raising=False)
        assert main(["run", "experiment=walk_circle", *overrides, f"hydra.run.dir={folder}"]) == 0
    return folder / "run.rrd"


@pytest.fixture(scope="module")
def parent(tmp_path_factory, cache):
    return record_run(tmp_path_factory.mktemp("parent"), cache, *SMALL)


@pytest.mark.slow
def test_an_unchanged_run_is_bitwise_identical(run, parent):
    code, output, folder = run("second", f"from={parent}", sandboxed=True)
    assert code == 0, output
    assert "→" not in output
    assert (read(parent).poses[1] == read(folder / "run.rrd").poses[1]).all()


def test_changed_settings_are_printed_and_the_parent_is_recorded(run, parent):
    code, output, folder = run("second", f"from={parent}", "seed=3", "inference.n_particles=50")
    assert code == 0, output
    assert "seed: 0 → 3\n" in output
    assert "inference.n_particles: 40 → 50\n" in output
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["experiment"] == "walk_circle"
    assert summary["settings"]["likelihood"]["effective_pixels"] == 0.7
    parent_id = read(parent).properties["run"]["id"]
    assert summary["provenance"]["parent"] == read(folder / "run.rrd").provenance["parent"] == parent_id


@pytest.mark.slow
def test_another_prior_has_the_settings_of_the_experiment(run, parent):
    code, output, folder = run("second", f"from={parent}", "prior=smooth", "prior.damping=2")
    assert code == 0, output
    settings = read(folder / "run.rrd").settings
    assert settings["prior"]["_target_"].endswith("Smooth")
    assert settings["prior"]["damping"] == 2
    assert settings["inference"]["n_particles"] == 40
    code, _, third = run("third", f"from={folder / 'run.rrd'}", "prior=walking")
    assert code == 0
    assert read(third / "run.rrd").settings["prior"] == read(parent).settings["prior"]


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["prior=smoth"], "smoth"),
        (["inference.n_particle=3"], "n_particle"),
        (["-m", "seed=1,2"], "starts one run"),
        (["dataset._target_=os.system"], "_target_"),
    ],
)
def test_an_impossible_change_is_refused(run, parent, overrides, message):
    result = run("second", f"from={parent}", *overrides)
    assert result.code == 2
    last = result.err.strip().splitlines()[-1]  # Hydra's log handlers of the parent may print before it
    assert last.startswith("workbench: ")
    assert message in last
    assert not (result.folder / "run.rrd").exists()


@pytest.mark.slow
def test_an_interrupted_run_leaves_a_readable_part_that_can_be_repeated(run, parent, monkeypatch):
    def log_or_interrupt(self, step, metrics, log=recorder.Recorder.log):
        if step.frame.index == 2:
            raise KeyboardInterrupt
        log(self, step, metrics)

    with monkeypatch.context() as patch:
        patch.setattr(recorder.Recorder, "log", log_or_interrupt)
        code, _, interrupted = run("interrupted", f"from={parent}")
    assert code == 130
    assert json.loads((interrupted / "summary.json").read_text())["status"] == "interrupted"
    part = read(interrupted / "run.rrd.part")
    assert (part.status, part.poses[0].tolist()) == ("interrupted", [0, 1])
    code, output, folder = run("again", f"from={interrupted}")  # from the first frame
    assert code == 0, output
    assert (read(folder / "run.rrd").poses[1] == read(parent).poses[1]).all()
