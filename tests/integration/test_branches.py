"""A run that branches off a recorded one: its configuration, but for what was said."""

import json

import numpy as np
import pytest
from omegaconf import OmegaConf

from workbench.cli.main import main
from workbench.experiment.resume import find_resumable
from workbench.experiment.run import execute
from workbench.recording.read import partial_run as earlier
from workbench.recording.read import partial_run as reading
from workbench.recording.read.partial_run import checkpoint_frames
from workbench.recording.read.reader import read
from workbench.recording.write import checkpoints, recorder

SMALL = ("dataset.n_frames=3", "inference.n_particles=40", "dataset.width=80", "dataset.height=60")
SMALL += ("dataset.person_px=40", "dataset.focal_px=90", "likelihood.effective_pixels=0.7")


def recorded(folder, cache, *overrides):
    """The recording of a run that tests share."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORKBENCH_CACHE", str(cache))
        patch.delenv("WORKBENCH_DATA", raising=False)
        patch.setattr(checkpoints, "MAX_FRACTION", np.inf)
        assert main(["run", "experiment=walk_circle", *overrides, f"hydra.run.dir={folder}"]) == 0
    return folder / "run.rrd"


@pytest.fixture(scope="module")
def first(tmp_path_factory, cache):
    return recorded(tmp_path_factory.mktemp("first"), cache, *SMALL)


@pytest.mark.slow
def test_unchanged_it_gives_the_same_bits(run, first):
    code, told, folder = run("second", f"from={first}", suspicious=True)
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
    assert summary["settings"]["likelihood"]["effective_pixels"] == 0.7
    parent = read(first).properties["run"]["id"]
    assert summary["provenance"]["parent"] == read(folder / "run.rrd").provenance["parent"] == parent


@pytest.mark.slow
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


@pytest.fixture(scope="module")
def long(tmp_path_factory, cache):
    """A run of 8 frames with checkpoints of all but the last, however small its file is."""
    return recorded(
        tmp_path_factory.mktemp("long"), cache, "dataset.n_frames=8", *SMALL[1:], "recorder.checkpoints=true"
    )


def rows(path, first):
    """Every curve that a recording has, from a frame on."""
    found = read(path)
    assert found.result
    return {name: (curve.frames[curve.frames >= first], curve.values[curve.frames >= first])
            for name, curve in found.scalars.items()}  # fmt: skip


def assert_same_curves(path, other, first):
    found, expected = rows(path, first), rows(other, first)
    assert found.keys() == expected.keys()
    for name, (frames, values) in found.items():
        np.testing.assert_array_equal(frames, expected[name][0], name)
        np.testing.assert_array_equal(values, expected[name][1], name)


@pytest.mark.parametrize(("frame", "repeated"), [(2, 2), (3, 0), (6, 3)])
@pytest.mark.slow
def test_it_goes_on_from_a_frame_with_the_same_bits(run, long, monkeypatch, frame, repeated):
    assert checkpoint_frames(read(long)) == [*range(7)]
    stored = reading._memories
    monkeypatch.setattr(reading, "_memories", lambda *words: {2: stored(*words)[2]})  # as in a file with room for one
    code, told, folder = run("second", f"from={long}@{frame}")
    assert code == 0, told
    assert f"{repeated} frames are repeated before frame {frame}\n" in told
    assert "→" not in told
    assert "does not come out" not in told
    assert read(folder / "run.rrd").poses[0].tolist() == list(range(frame, 8))
    assert_same_curves(folder / "run.rrd", long, frame)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["provenance"]["parent_frame"] == frame
    assert summary["identity"] != json.loads((long.parent / "summary.json").read_text())["identity"]


def cut_at(frame, patch):
    """Interrupt runs at a frame."""

    def cut(self, step, metrics, log=recorder.Recorder.log):
        if step.frame.index == frame:
            raise KeyboardInterrupt
        log(self, step, metrics)

    patch.setattr(recorder.Recorder, "log", cut)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [(), ("seed=3", "inference.n_particles=50")])
def test_a_run_that_goes_on_from_another_can_be_gone_on_from(run, long, monkeypatch, changes):
    _, _, second = run("second", f"from={long}@3", *changes)
    assert checkpoint_frames(read(second / "run.rrd"))[0] == 3
    code, told, third = run("third", f"from={second / 'run.rrd'}@6")
    assert code == 0, told
    assert "does not come out" not in told
    assert read(third / "run.rrd").poses[0].tolist() == [6, 7]
    assert_same_curves(third / "run.rrd", second / "run.rrd", 6)
    with monkeypatch.context() as patch:
        cut_at(6, patch)
        code, _, cut = run("cut", f"from={long}@3", *changes)
    assert code == 130
    code, told, fourth = run("fourth", f"from={cut}")
    assert code == 0, told
    assert read(fourth / "run.rrd").poses[0].tolist() == [5, 6, 7]
    assert_same_curves(fourth / "run.rrd", second / "run.rrd", 5)


@pytest.mark.slow
def test_a_run_that_was_cut_off_goes_on_from_what_is_on_disk(run, long, monkeypatch):
    with monkeypatch.context() as patch:
        cut_at(6, patch)
        code, _, folder = run("cut", f"from={long}")
    assert code == 130
    code, told, whole = run("second", f"from={folder}")
    assert code == 0, told
    assert read(whole / "run.rrd").poses[0].tolist() == [5, 6, 7]
    assert_same_curves(whole / "run.rrd", long, 5)


@pytest.mark.slow
def test_a_run_that_was_cut_off_becomes_the_whole_run(long, tmp_path, monkeypatch):
    config, part = OmegaConf.create(read(long).config), tmp_path / "earlier.rrd.part"
    monkeypatch.setattr(checkpoints, "MAX_FRACTION", np.inf)
    with monkeypatch.context() as patch:
        cut_at(6, patch)
        with pytest.raises(KeyboardInterrupt):
            execute(config, "walk_circle", tmp_path, quiet=True)
    (tmp_path / "run.rrd.part").rename(part)
    found = find_resumable(config, [part])
    assert (found.frame, found.skipped) == (5, 5)
    summary = execute(config, "walk_circle", tmp_path, quiet=True, continued=found)
    assert_same_curves(tmp_path / "run.rrd", long, 0)
    assert dict(read(tmp_path / "run.rrd").result) == dict(read(long).result)
    assert summary.identity == json.loads((long.parent / "summary.json").read_text())["identity"]
    assert summary.provenance["continued"] == f"{read(part).properties['run']['id']}@5"
    assert checkpoint_frames(read(tmp_path / "run.rrd")) == [*range(7)]
    assert read(tmp_path / "run.rrd").marginals.frames.tolist() == [*range(8)]

    assert find_resumable(config, []) is None
    assert "configuration" in find_resumable(OmegaConf.merge(config, {"seed": 1}), [part])
    monkeypatch.setattr(earlier, "checkpoint_frames", lambda run: [])
    assert "no checkpoint" in find_resumable(config, [part])


@pytest.mark.parametrize(
    ("source", "words"),
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
def test_where_it_cannot_go_on_it_says_why(run, long, source, words):
    done = run("second", *f"from={source.format(run=long, folder=long.parent)}".split())
    assert done.code == 2
    assert words in done.err
