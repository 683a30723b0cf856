"""Recordings of other machines are decoded in the sandbox first, and damaged ones do not affect sound ones."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from damage import changes, damaged, flips, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from kinds_of_recordings import write_kinds
from run_folders import write_run
from small_recordings import record, write_recorded_run

from workbench.cli.main import main
from workbench.experiment.summary import Summary
from workbench.recording.format import FORMAT
from workbench.recording.read import crash_probe as probe
from workbench.recording.read.crash_probe import crashing_recordings, is_own, open_sound_runs, read_sound_run
from workbench.utils.errors import LONGEST, InputError

BASELINES = Path(__file__).parents[2] / "recordings" / "baselines"


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """Return the bytes of a recording of each kind."""
    return [path.read_bytes() for path in sorted(write_kinds(tmp_path_factory.mktemp("kinds")).glob("*.rrd"))]


@pytest.mark.slow
def test_random_damage_is_refused_or_read(kinds, tmp_path):
    """Each of n damaged recordings is read or refused, and the sound one in their folder is read."""
    n = 19  # with the sound one, as many as one child process decodes
    (tmp_path / "sound.rrd").write_bytes(kinds[0])

    @given(st.lists(changes | flips, min_size=n, max_size=n), st.booleans())
    @settings(max_examples=4)
    def read_or_refuse(damages, partial):
        for k, chosen in enumerate(damages):
            content = damaged(kinds[k % len(kinds)], chosen)
            (tmp_path / f"{k:03d}.rrd{'.part' * (partial and k % 2)}").write_bytes(content)
        runs, problems = open_sound_runs(tmp_path)
        assert tmp_path / "sound.rrd" in [run.path for run in runs]
        assert len(runs) + len(problems) == n + 1
        assert all(len(problem.reason) <= LONGEST for problem in problems)
        for run in runs:
            refusal(
                lambda run=run: (run.settings, run.joints, run.true_joints, run.scalars, run.marginals, run.figures)
            )
        for path in tmp_path.glob("0*"):
            path.unlink()

    read_or_refuse()


@pytest.mark.parametrize("bad", [{0}, {3, 4, 48}, {19}, set(range(50))])
def test_the_recordings_that_crash_are_identified(tmp_path, monkeypatch, bad):
    paths = [tmp_path / f"{k}.rrd" for k in range(50)]
    for path in paths:
        path.touch()

    def parse_limited(parse, *tested, what):
        if any(int(path.stem) in bad for path in tested):
            raise InputError("crashed")

    monkeypatch.setattr(probe, "parse_limited", parse_limited)
    assert crashing_recordings([*paths, tmp_path / "none.rrd"]) == {paths[k] for k in bad}


FLIPS = {"period_snr": [(8003, 3), (6586, 1), (50009, 7)], "arm_twist": [(3493, 4), (79294, 0), (1270, 2)]}
"""Bits (byte, number) of baselines that, flipped, crash the decoder of Rerun 0.41 or fill the memory."""


@pytest.mark.slow
def test_flipped_bits_that_crash_the_decoder_are_refused_or_read(tmp_path):
    for name, bits in FLIPS.items():
        content = (BASELINES / f"{name}.rrd").read_bytes()
        (tmp_path / f"{name}.rrd").write_bytes(content)
        for at, bit in bits:
            flipped = bytearray(content)
            flipped[at % len(content)] ^= 1 << bit
            (tmp_path / f"{name}_{at}.rrd").write_bytes(flipped)
    runs, problems = open_sound_runs(tmp_path)
    assert {"period_snr", "arm_twist"} <= {run.path.stem for run in runs}
    assert len(runs) + len(problems) == 8


def test_decoding_that_exceeds_the_memory_limit_is_refused(tmp_path, monkeypatch):
    """With a flipped bit of a length, Rerun's decoder reserves gigabytes before it reports the damage."""
    path = write_recorded_run(tmp_path / "run", "run") / "run.rrd"
    probe.decode(path)

    def reserve_and_report(path):
        np.ones(450_000_000, np.uint8)
        raise InputError(f"{path}: damaged")

    monkeypatch.setattr(probe, "read", reserve_and_report)
    with pytest.raises(MemoryError):
        probe.decode(path)


def test_runs_of_this_machine_are_read_without_the_sandbox(tmp_path, monkeypatch):
    own, other, alone = (tmp_path / name / "run.rrd" for name in ("own", "other", "alone"))
    write_recorded_run(other.parent, "other")
    for path in (own, alone):
        path.parent.mkdir()
        record(path, path.parent.name)
    Summary("walk", 0, own).write(own.with_name("summary.json"))
    assert [is_own(path) for path in (own, other, alone)] == [True, False, False]
    sandboxed = []
    monkeypatch.setattr(probe, "parse_limited", lambda parse, *paths, what: sandboxed.extend(paths))
    assert len(open_sound_runs(tmp_path)[0]) == 3
    assert set(sandboxed) == {other, alone}


def test_an_unknown_body_is_refused(tmp_path):
    stream = rr.RecordingStream("other", recording_id="other")
    stream.set_sinks(rr.FileSink(tmp_path / "a.rrd"))
    for name, values in (("run", {"status": "complete", "format": FORMAT}), ("body", {"joints": 3})):
        stream.send_property(name, rr.AnyValues(**values))
    stream.flush()
    stream.disconnect()
    assert "property body.joints: expected texts, found 3" in refusal(read_sound_run, tmp_path / "a.rrd")


COMMANDS = (
    "check {run}", "check {run} {other}", "report {run}", "view {run}", "measure {run}", "export {run} -o {run}.csv",
    "runs list {run}", "runs list {folder}", "runs restore {folder}", "runs restore --changes {folder}",
    "run from={run}", "run from={folder}",
)  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_decodes_a_recording_that_crashes_in_the_sandbox(kinds, command, tmp_path, capsys, monkeypatch):
    folder = write_run(
        tmp_path / "folder", status="running" if command.startswith("runs list {folder}") else "complete"
    )
    for path in (folder / "run.rrd", tmp_path / "other.rrd"):
        path.write_bytes(kinds[0])
    monkeypatch.setattr("workbench.cli.view.viewer", lambda: Path("true"))
    monkeypatch.setattr(probe, "crashing_recordings", lambda paths: {Path(path) for path in paths})
    paths = {"run": folder / "run.rrd", "other": tmp_path / "other.rrd", "folder": folder}
    code = main([word.format(**paths) for word in command.split()])
    output = " ".join("".join(capsys.readouterr()).split())
    assert "run.rrd: expected a whole recording, found damage that crashes its decoder" in output
    assert code == (0 if command.startswith(("report", "runs list")) else 2)
    assert "Traceback" not in output
