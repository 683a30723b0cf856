"""`workbench`: help without heavy imports, suggestions for mistyped commands, one message on invalid input."""

import os
import subprocess
import sys
from signal import SIGINT, SIGTERM
from types import SimpleNamespace

import pytest
from hydra.core.global_hydra import GlobalHydra

from workbench.cli import main as module
from workbench.cli.main import COMMANDS, main
from workbench.inference.smc.weights import DegenerateWeights
from workbench.utils.signals import Interrupted

RUNS = (
    "dataset=video", "body=height", "dataset=video dataset.source=x.mp4", "dataset=point_files dataset.source=nowhere",
    "prior=walkin", "prior=schema_walking", "inference.n_particle=100", "inference.n_particles=many",
    "inference.n_particles=0", "seed=-1", "n_threads=100000", "dataset.motion=file.bvh", "=3", "seed", "seed=",
    "+prior.new_key=3", "~prior", "~seed", "prior=[walking", "'seed=3", "--bogus", "-x", "--seed 3",
    "from=nowhere.rrd", "from=nowhere.rrd seed=1", "component_packages=[no_such_package]",
    "component_packages=no_such_package", "study=nothing", "inference=hybrid likelihood=image_motion",
    "likelihood=keypoints", "dataset=blank", "dataset=points likelihood=image_motion", "inference=least_squares",
    "prior.motions=everything", "prior.motions=cmu", "dataset.n_frames=100000", "body=height body.height_m=180",
    "likelihood.reduction=total",
    "experiment=impute_gaps study.fractions=[1.5]", "experiment=learn_walk_run study.activities=[swim]",
    "--experimental-rerun=x.pickle",
)  # fmt: skip
OTHER_COMMANDS = (
    "rnu", "reports", "walk", "view", "view nowhere.rrd", "view .", "report nowhere", "report --no-such-option .",
    "check nowhere.rrd", "check nowhere.rrd inference=x", "check --seeds 1 nowhere.rrd", "runs --view many",
    "measure nowhere.rrd", "export nowhere.rrd -o walk.bvh", "export run.rrd",
    "import nowhere -o no/out.h5", "components prior.no_such",
    "calibrate board left -o c.toml --corners 9x6 --square-mm 25", "annotate none.mp4 -o marks.csv",
    "check-calibration seed=3", "--version=3",
)  # fmt: skip


@pytest.fixture
def call(tmp_path, monkeypatch, capfd):
    """A function that runs the command in an empty folder and returns its exit code and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)

    def command(*words):
        try:
            code = main(words)
        except SystemExit as error:
            code = error.code
        return code, capfd.readouterr().err

    yield command
    GlobalHydra.instance().clear()


def is_rejected(code, err):
    return code == 2 and bool(err.strip()) and "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize("words", RUNS)
def test_invalid_input_of_a_run_is_rejected(words, call):
    assert is_rejected(*call("run", *words.split()))


@pytest.mark.parametrize("words", OTHER_COMMANDS)
def test_invalid_input_of_the_other_commands_is_rejected(words, call):
    assert is_rejected(*call(*words.split()))


@pytest.mark.parametrize(
    ("words", "suggestion"),
    [
        (["experiment=walk_circle", "seed=range(2)"], "workbench run experiment=walk_circle 'seed=range(2)'"),
        (["-m", "seed=1,2"], "workbench run -m seed=1,2"), (["chek", "a.rrd"], "workbench check"),
        (["walk_circel"], "workbench run experiment=walk_circle"),
    ],
)  # fmt: skip
def test_an_unknown_command_is_answered_by_a_suggestion(words, suggestion, call):
    code, err = call(*words)
    assert is_rejected(code, err)
    assert err.count("\n") == 1
    assert suggestion in err


@pytest.mark.parametrize("words", [*COMMANDS, "calibrate board", "calibrate height"])
def test_every_command_has_help(words, capsys):
    code = 0
    try:
        code = main([*words.split(), "--help"])
    except SystemExit as error:  # of argparse
        code = error.code
    assert code == 0
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize(("words", "texts"), [((), list(COMMANDS)), (("--version",), ["workbench 0."]), (("rnu",), [])])
def test_help_and_a_mistyped_command_import_no_subcommand(words, texts):
    heavy = {"numpy", "numba", "scipy", "rerun", "hydra", "h5py", "cv2", "pandas"}
    code = f"import sys; from workbench.cli.main import main; main({words}); print({heavy} & set(sys.modules))"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert output.splitlines()[-1] == "set()"
    assert all(text in output for text in texts)


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (KeyboardInterrupt(), 130, "SIGINT"), (Interrupted(SIGTERM), 128 + SIGTERM, "SIGTERM"),
        (Interrupted(SIGINT), 130, "SIGINT"), (OSError(28, "No space left", "run.log"), 1, "run.log: No space left"),
        (DegenerateWeights("frame 3"), 1, "frame 3"),
    ],
)  # fmt: skip
def test_exit_codes_of_interruptions_and_errors(error, code, text, monkeypatch, capsys):
    def fail():
        raise error

    monkeypatch.setattr(module, "import_module", lambda name: SimpleNamespace(components=fail))
    assert main(["components"]) == code
    err = capsys.readouterr().err
    assert text in err
    assert err.count("\n") == 1
    error = ZeroDivisionError("a defect is raised with its traceback")
    with pytest.raises(ZeroDivisionError):
        main(["components"])


@pytest.mark.parametrize("words", ["--help", "components", "run --cfg job", "runs list FOLDER"])
@pytest.mark.slow
def test_a_command_exits_without_a_message_when_its_output_is_closed(words, tmp_path):
    command = [sys.executable, "-m", "workbench", *words.replace("FOLDER", str(tmp_path)).split()]
    read, write = os.pipe()
    os.close(read)
    process = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (process.returncode, process.stderr) == (1, "")
