"""Many recordings at once, and what a `Run` tells of one."""

import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr
from recording_steps import BODY, SPACE, errors, steps
from run_folders import leave

from workbench.body.kinematics import joints
from workbench.cli.check import main as check
from workbench.cli.export import main as export
from workbench.cli.report import main as report
from workbench.cli.run import main as run_of
from workbench.cli.runs import main as runs
from workbench.cli.view import main as view
from workbench.cli.why import main as why
from workbench.errors import InputError
from workbench.recording.compare.condense import condense
from workbench.recording.compare.side_by_side import write_side_by_side
from workbench.recording.read.probe import fatal
from workbench.recording.read.reader import find_recordings, open_runs, read
from workbench.recording.write.file import FORMAT, RecordingFile
from workbench.recording.write.recorder import Recorder

FORMAT_1 = Path(__file__).parent / "recordings" / "format_1.rrd"
N = 3


@pytest.fixture(scope="module")
def run():
    return list(steps(N, n_particles=20))


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("open") / "run.rrd", run, config_yaml="seed: 3\nprior: {sigma: 1.0e-05}")


def record(path, run, config_yaml="seed: 3"):
    with Recorder(path, BODY, SPACE, run_id=path.name, config_yaml=config_yaml, provenance={"seed": 3}) as recording:
        for step in run:
            recording.log(step, errors(step))
        recording.set_result({"error_mm": 1.0})
    return path


def configured(path, text):
    with RecordingFile(path, run_id="x", config_yaml=text, provenance={"seed": 0}):
        pass
    return read(path)


@pytest.fixture
def folder(recorded, tmp_path):
    """Two good runs, one cut off, one that is none, and files that are no recordings."""
    for name in ("b/run.rrd", "a/0/run.rrd", "a/1/run.rrd.part"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recorded, tmp_path / name)
    (tmp_path / "a" / "junk.rrd").write_bytes(b"junk" * 100)
    (tmp_path / "a" / "run.rrd.txt").write_text("no recording")
    (tmp_path / "summary.json").write_text("{}")
    return tmp_path


def test_all_are_found_sorted_and_one_that_cannot_be_read_does_not_stop_the_others(folder):
    runs, problems = open_runs(folder)
    assert [str(run.path.relative_to(folder)) for run in runs] == ["a/0/run.rrd", "a/1/run.rrd.part", "b/run.rrd"]
    assert [problem.path.name for problem in problems] == ["junk.rrd"]
    assert "junk.rrd: expected a whole Rerun recording" in problems[0].reason


def test_files_and_folders_may_overlap(folder):
    runs, problems = open_runs(folder / "b", folder / "b" / "run.rrd", folder / "a" / "junk.rrd")
    assert ([run.path.parent.name for run in runs], len(problems)) == (["b"], 1)


def test_a_folder_without_recordings_and_a_place_that_is_not_there(tmp_path):
    assert open_runs(tmp_path) == ([], [])
    with pytest.raises(InputError, match="nowhere: expected a recording or a folder"):
        find_recordings(tmp_path / "nowhere")


def test_joints_are_those_of_the_poses_and_of_the_truth(recorded, run):
    found = read(recorded)
    assert found.joints.names == found.true_joints.names == BODY.skeleton.names
    assert found.joints.frames.tolist() == found.true_joints.frames.tolist() == [step.frame.index for step in run]
    # recorded to float32, coordinates of some metres: 2e-7 m
    np.testing.assert_allclose(found.joints.positions, joints(BODY.skeleton, found.poses[1]), atol=1e-6)
    np.testing.assert_allclose(found.true_joints.positions, [step.frame.truth.joints for step in run], atol=1e-6)


def test_a_run_without_frames_has_joints_of_no_frame(tmp_path):
    found = read(record(tmp_path / "run.rrd", []))
    assert found.joints.positions.shape == found.true_joints.positions.shape == (0, len(BODY.skeleton.names), 3)


def test_settings_are_the_configuration_as_plain_values(recorded):
    found = read(recorded)
    assert found.settings == {"seed": 3, "prior": {"sigma": 1e-5}}
    assert found.result == {"error_mm": 1.0}
    assert found.provenance["seed"] == 3
    assert not found.is_study
    assert found.format == FORMAT
    assert found.platform


def test_nothing_is_looked_up_for_a_stranger_s_configuration(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET", "42")
    found = configured(tmp_path / "run.rrd", "name: ${oc.env:SECRET}\n")
    assert found.settings == {"name": "${oc.env:SECRET}"}


BOMB = "a: &a [x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefghijkl", "bcdefghijklm", strict=True)
)


@pytest.mark.parametrize(
    "text",
    ["", "just words", "[1, 2]", "a: [", "1: 2", BOMB, "a: " + "[" * 1500, "a: !!python/object/apply:os.getcwd []"],
    ids=["empty", "words", "list", "torn", "number", "references", "deep", "object"],
)
def test_settings_that_are_no_plain_mapping_are_refused(tmp_path, text):
    with pytest.raises(InputError, match=r"run\.rrd: expected the configuration to be a mapping in plain YAML"):
        _ = configured(tmp_path / "run.rrd", text).settings


def test_a_recording_without_a_format_number_is_of_format_1():
    found = read(FORMAT_1)
    assert (found.format, found.platform, found.status) == (1, None, "complete")
    assert found.poses[1].shape == (4, 25)
    assert found.joints.positions.shape == found.true_joints.positions.shape == (4, 15, 3)
    assert found.marginals.log_mass.shape[2] == 4
    assert found.settings["inference"]["n_particles"] == 40
    assert found.result["error_abs_mm"] == pytest.approx(found.metric("error_abs_mm")[1][1:].mean())


@pytest.mark.parametrize("version", [FORMAT + 1, "two"])
def test_a_newer_format_is_refused(tmp_path, version):
    with RecordingFile(tmp_path / "run.rrd", run_id="x", config_yaml="", provenance={}) as file:
        file.send_property("run", {"format": version})
    with pytest.raises(InputError, match=f"format 1 to {FORMAT}, found {version!r}"):
        read(tmp_path / "run.rrd")


@pytest.fixture
def strange(tmp_path):
    """A run of ours by its properties, whose body no reader understands."""
    path = tmp_path / "strange.rrd"
    stream = rr.RecordingStream("other", recording_id="strange")
    stream.set_sinks(rr.FileSink(path))
    for name, values in (("run", {"status": "complete"}), ("body", {"joints": 3})):
        stream.send_property(name, rr.AnyValues(**values))
    stream.flush()
    stream.disconnect()
    return path


def test_a_body_that_no_reader_understands_is_refused_in_a_sentence(recorded, strange):
    with pytest.raises(InputError, match=r"strange\.rrd: property body\.joints: expected texts, found 3"):
        read(strange)
    assert fatal([recorded, strange, FORMAT_1]) == set()


def test_what_reading_does_not_survive_is_found_by_another_process(monkeypatch):
    """Which says a word for every file until it ends, and another goes on behind the one that it ended of."""

    def until_b(command, *, input, **_):
        names = input.split(b"\0")
        told = names[: names.index(b"b")] if b"b" in names else names
        return SimpleNamespace(stdout=b"".join(b"damaged\n" if name == b"d" else b"read\n" for name in told))

    monkeypatch.setattr("workbench.recording.read.probe.subprocess.run", until_b)
    assert fatal([Path(name) for name in "abcde"]) == {Path("b"), Path("d")}


def started(arguments):
    """The command that runs, which takes what it is told from the command line."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["workbench", *arguments])
        return run_of()


COMMANDS = {
    "check": (check, ["{run}"]), "check of two": (check, ["{run}", "{other}"]), "report": (report, ["{run}"]),
    "view": (view, ["{run}"]), "export": (export, ["{run}", "{run}.csv"]), "why": (why, ["{run}"]),
    "runs": (runs, ["{run}", "--all"]), "runs, killed when published": (runs, ["{folder}", "--all"]),
    "restore": (runs, ["--restore", "{folder}"]), "changes": (runs, ["--changes", "{folder}"]),
    "slim": (runs, ["{root}", "--slim", "--yes"]), "from": (started, ["from={run}"]),
    "from a folder": (started, ["from={folder}"]), "from a frame": (started, ["from={run}@1"]),
}  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS)
def test_no_command_reads_what_another_process_did_not_survive(recorded, words, tmp_path, capsys, monkeypatch):
    """Here a sound one, of which that is said: so nothing else is wrong with it."""
    command, arguments = COMMANDS[words]
    killed = words == "runs, killed when published"
    folder = leave(tmp_path / "folder", status="running" if killed else "complete")
    for name in ("folder/run.rrd", "other.rrd"):
        shutil.copy(recorded, tmp_path / name)
    monkeypatch.setattr("workbench.cli.view.viewer", lambda: Path("true"))
    monkeypatch.setattr("workbench.recording.read.probe.fatal", lambda paths, *_: {Path(path) for path in paths})
    places = {"run": folder / "run.rrd", "other": tmp_path / "other.rrd", "folder": folder, "root": tmp_path}
    code = command([argument.format(**places) for argument in arguments])
    told = "".join(capsys.readouterr())
    assert "run.rrd: expected a whole recording, found damage that crashes whoever reads it" in " ".join(told.split())
    assert code == (0 if words.startswith(("report", "runs")) else 2)
    assert "Traceback" not in told


def test_recordings_are_laid_beside_each_other_only_if_another_process_read_all_of_them(
    recorded, tmp_path, monkeypatch
):
    run, asked = read(recorded), []
    monkeypatch.setattr("workbench.recording.read.probe.fatal", lambda paths, whole: asked.append(whole) or set(paths))
    with pytest.raises(InputError, match="damage that crashes whoever reads it"):
        write_side_by_side(tmp_path / "both.rrd", run, run)
    assert asked == [True]


def test_a_run_whose_id_is_lost_is_laid_beside_another_and_condensed(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr("workbench.recording.read.probe.fatal", lambda *_, **__: set())
    run = read(recorded)
    properties = {**run.properties, "run": {key: run.properties["run"][key] for key in ("status", "format")}}
    lost = replace(run, properties=properties)
    assert (lost.id, run.id) == ("", run.properties["run"]["id"])
    write_side_by_side(tmp_path / "both.rrd", lost, run)
    condense(lost, tmp_path / "condensed.rrd")
    assert read(tmp_path / "condensed.rrd").metrics.keys() == run.metrics.keys()


@pytest.mark.parametrize(
    ("reading", "outcome"),
    [
        ("bytearray(6 * 10**9)", (b"damaged", 0)),
        ("time.sleep(60)", (b"", -signal.SIGALRM)),
        ("sum(0 for _ in iter(int, 1))", (b"", -signal.SIGPROF)),
    ],
)
def test_reading_takes_so_much_memory_and_time_and_no_more(recorded, reading, outcome):
    patience = 3 if "sleep" in reading else 600
    code = "import pathlib, time, workbench.recording.read.probe as probe\n"
    code += f"probe._LONGEST_S, probe._PATIENCE = 1, {patience}\n"
    code += f"probe.read_all = lambda path: {reading}\nprobe.main([pathlib.Path({str(recorded)!r})])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.stdout.strip(), done.returncode) == outcome, done.stderr


def test_what_lies_beside_the_numbers_is_found_damaged_where_all_is_to_be_read(recorded):
    code = "import pathlib, workbench.recording.read.probe as probe\n"
    code += "probe.read_chunks = lambda *_: bytearray(10**11)\n"
    code += f"probe.main([pathlib.Path({str(recorded)!r})], whole=True)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.stdout.strip(), done.returncode) == (b"damaged", 0), done.stderr
    assert fatal([recorded], whole=True) == set()
