"""Runs that start from a recording (`from=RUN`) or resume it at a frame (`from=RUN@FRAME`)."""

import json

import numpy as np
import pytest
from omegaconf import OmegaConf

from workbench.cli.main import main
from workbench.experiment.resume import find_resumable
from workbench.experiment.run import execute
from workbench.recording.read import partial_run
from workbench.recording.read.partial_run import checkpoint_frames
from workbench.recording.read.reader import read
from workbench.recording.write import checkpoints, recorder

SMALL = ("dataset.n_frames=3", "inference.n_particles=40", "dataset.width=80", "dataset.height=60")
SMALL += ("dataset.person_px=40", "dataset.focal_px=90", "likelihood.effective_pixels=0.7")


def record_run(folder, cache, *overrides):
    """Run in a folder and return the recording."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORKBENCH_CACHE", str(cache))
        patch.delenv("WORKBENCH_DATA", raising=False)
        patch.setattr(checkpoints, "MAX_FRACTION", np.inf)
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


@pytest.fixture(scope="module")
def checkpointed(tmp_path_factory, cache):
    """Return the recording of a run of 8 frames with a checkpoint of each frame but the last."""
    return record_run(
        tmp_path_factory.mktemp("checkpointed"), cache, "dataset.n_frames=8", *SMALL[1:], "recorder.checkpoints=true"
    )


def curves_from(path, first):
    """Return frames and values of every curve of a recording, from frame `first`."""
    recording = read(path)
    assert recording.result
    return {name: (curve.frames[curve.frames >= first], curve.values[curve.frames >= first])
            for name, curve in recording.scalars.items()}  # fmt: skip


def assert_same_curves(path, other, first):
    curves, expected = curves_from(path, first), curves_from(other, first)
    assert curves.keys() == expected.keys()
    for name, (frames, values) in curves.items():
        np.testing.assert_array_equal(frames, expected[name][0], name)
        np.testing.assert_array_equal(values, expected[name][1], name)


@pytest.mark.parametrize(("frame", "repeated"), [(2, 2), (3, 0), (6, 3)])
@pytest.mark.slow
def test_a_run_resumed_at_a_frame_is_bitwise_identical(run, checkpointed, monkeypatch, frame, repeated):
    assert checkpoint_frames(read(checkpointed)) == [*range(7)]
    stored = partial_run._memories
    # leave only the checkpoint of frame 2
    monkeypatch.setattr(partial_run, "_memories", lambda *arguments: {2: stored(*arguments)[2]})
    code, output, folder = run("second", f"from={checkpointed}@{frame}")
    assert code == 0, output
    assert f"{repeated} frames are repeated before frame {frame}\n" in output
    assert "→" not in output
    assert "does not come out" not in output
    assert read(folder / "run.rrd").poses[0].tolist() == list(range(frame, 8))
    assert_same_curves(folder / "run.rrd", checkpointed, frame)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["provenance"]["parent_frame"] == frame
    assert summary["identity"] != json.loads((checkpointed.parent / "summary.json").read_text())["identity"]


def interrupt_at(frame, patch):
    """Interrupt runs at a frame."""

    def log_or_interrupt(self, step, metrics, log=recorder.Recorder.log):
        if step.frame.index == frame:
            raise KeyboardInterrupt
        log(self, step, metrics)

    patch.setattr(recorder.Recorder, "log", log_or_interrupt)


@pytest.mark.slow
def test_a_resumed_run_can_be_resumed(run, checkpointed, monkeypatch):
    changes = ("seed=3", "inference.n_particles=50")
    _, _, second = run("second", f"from={checkpointed}@3", *changes)
    assert checkpoint_frames(read(second / "run.rrd"))[0] == 3
    code, output, third = run("third", f"from={second / 'run.rrd'}@6")
    assert code == 0, output
    assert "does not come out" not in output
    assert read(third / "run.rrd").poses[0].tolist() == [6, 7]
    assert_same_curves(third / "run.rrd", second / "run.rrd", 6)
    with monkeypatch.context() as patch:
        interrupt_at(6, patch)
        code, _, interrupted = run("interrupted", f"from={checkpointed}@3", *changes)
    assert code == 130
    code, output, fourth = run("fourth", f"from={interrupted}")
    assert code == 0, output
    assert read(fourth / "run.rrd").poses[0].tolist() == [5, 6, 7]
    assert_same_curves(fourth / "run.rrd", second / "run.rrd", 5)


@pytest.mark.slow
def test_an_interrupted_run_resumes_at_its_last_checkpoint(run, checkpointed, monkeypatch):
    with monkeypatch.context() as patch:
        interrupt_at(6, patch)
        code, _, folder = run("interrupted", f"from={checkpointed}")
    assert code == 130
    code, output, second = run("second", f"from={folder}")
    assert code == 0, output
    assert read(second / "run.rrd").poses[0].tolist() == [5, 6, 7]
    assert_same_curves(second / "run.rrd", checkpointed, 5)


@pytest.mark.slow
def test_an_interrupted_run_is_completed_to_the_uninterrupted_one(checkpointed, tmp_path, monkeypatch):
    config, part = OmegaConf.create(read(checkpointed).config), tmp_path / "interrupted.rrd.part"
    monkeypatch.setattr(checkpoints, "MAX_FRACTION", np.inf)
    with monkeypatch.context() as patch:
        interrupt_at(6, patch)
        with pytest.raises(KeyboardInterrupt):
            execute(config, "walk_circle", tmp_path, quiet=True)
    (tmp_path / "run.rrd.part").rename(part)
    resumable = find_resumable(config, [part])
    assert (resumable.frame, resumable.skipped) == (5, 5)
    summary = execute(config, "walk_circle", tmp_path, quiet=True, continued=resumable)
    assert_same_curves(tmp_path / "run.rrd", checkpointed, 0)
    assert dict(read(tmp_path / "run.rrd").result) == dict(read(checkpointed).result)
    assert summary.identity == json.loads((checkpointed.parent / "summary.json").read_text())["identity"]
    assert summary.provenance["continued"] == f"{read(part).properties['run']['id']}@5"
    assert checkpoint_frames(read(tmp_path / "run.rrd")) == [*range(7)]
    assert read(tmp_path / "run.rrd").marginals.frames.tolist() == [*range(8)]

    assert find_resumable(config, []) is None
    assert "configuration" in find_resumable(OmegaConf.merge(config, {"seed": 1}), [part])
    monkeypatch.setattr(partial_run, "checkpoint_frames", lambda run: [])
    assert "no checkpoint" in find_resumable(config, [part])


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("{run}@8", "0 to 7), found 8"),
        ("{folder}", "the run is complete"),
        ("{run}@5 prior=smooth", "columns"),
        ("{run}@5 inference=backward_simulation", "cannot resume at a frame"),
        ("{run}@5 dataset.first_frame=1", "the first frame of the resumed run, 0"),
        ("nothing.rrd@5", "no such recording"),
    ],
)
@pytest.mark.slow
def test_an_impossible_resumption_is_refused(run, checkpointed, source, message):
    result = run("second", *f"from={source.format(run=checkpointed, folder=checkpointed.parent)}".split())
    assert result.code == 2
    assert message in result.err
