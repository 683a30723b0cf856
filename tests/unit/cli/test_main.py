"""The command: help without imports, mistyped words, and wrong input of every subcommand as one sentence."""

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
    "dataset=video", "body=height", "dataset=video body=height experiment=custom", "dataset=video dataset.source=x.mp4",
    "dataset=point_files dataset.source=nowhere", "prior=walkin", "prior=schema_walking", "experiment=track_vidoe",
    "inference.n_particle=100", "sed=3", "inference.n_particles=many", "inference.n_particles=0", "seed=-1",
    "n_threads=100000", "dataset.n_frames=-5", "dataset.motion=file.bvh", "experiment=walk_video", "=3", "seed",
    "seed=",
    "+prior.new_key=3", "++inference.what=1", "~prior", "~seed", "prior=[walking", "'seed=3", "--bogus", "-x",
    "--seed 3", "from=nowhere.rrd", "from=nowhere.rrd@12 seed=1", "component_packages=[no_such_package]",
    "component_packages=no_such_package",
    "study=nothing", "inference=hybrid likelihood=image_motion", "likelihood=keypoints", "dataset=blank",
    "dataset=points likelihood=image_motion", "inference=least_squares", "prior.motions=everything",
    "dataset.n_frames=100000", "body=height body.height_m=180", "likelihood.reduction=total", "prior.motions=cmu",
    "experiment=impute_gaps study.fractions=[1.5]", "experiment=learn_walk_run study.activities=[swim]",
    "--experimental-rerun=x.pickle",
)  # fmt: skip
OTHERS = (
    "rnu", "reports", "walk", "view", "view nowhere.rrd", "view .", "report nowhere", "report --no-such-option .",
    "check nowhere.rrd", "check nowhere.rrd inference=x", "check --seeds 1 nowhere.rrd", "runs --view many",
    "export nowhere.rrd -o walk.bvh", "export run.rrd", "import nowhere -o no/out.h5", "components prior.no_such",
    "calibrate board left -o c.toml --corners 9x6 --square-mm 25", "annotate none.mp4 -o marks.csv",
    "check-calibration seed=3", "--version=3",
)  # fmt: skip


@pytest.fixture
def ends(tmp_path, monkeypatch, capfd):
    """Call the command in an empty folder: the exit code, however it ends, and what it prints to stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)

    def call(*words):
        try:
            code = main(words)
        except SystemExit as ended:
            code = ended.code
        return code, capfd.readouterr().err

    yield call
    GlobalHydra.instance().clear()


def is_one_sentence(code, err):
    return code == 2 and bool(err.strip()) and "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize("words", RUNS)
def test_wrong_input_of_a_run_is_one_sentence(words, ends):
    assert is_one_sentence(*ends("run", *words.split()))


@pytest.mark.parametrize("words", OTHERS)
def test_wrong_input_of_the_other_commands_is_one_sentence(words, ends):
    assert is_one_sentence(*ends(*words.split()))


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["experiment=walk_circle", "seed=range(2)"], "workbench run experiment=walk_circle 'seed=range(2)'"),
        (["-m", "seed=1,2"], "workbench run -m seed=1,2"), (["chek", "a.rrd"], "workbench check"),
        (["walk_circel"], "workbench run experiment=walk_circle"),
    ],
)  # fmt: skip
def test_a_first_word_that_is_no_command_gets_what_is_meant(words, meant, ends):
    code, err = ends(*words)
    assert is_one_sentence(code, err)
    assert err.count("\n") == 1
    assert meant in err


@pytest.mark.parametrize("words", [*COMMANDS, "calibrate board", "calibrate height"])
def test_every_command_has_a_help(words, capsys):
    code = 0
    try:
        code = main([*words.split(), "--help"])
    except SystemExit as ended:  # argparse's
        code = ended.code
    assert code == 0
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize(("words", "shown"), [((), list(COMMANDS)), (("--version",), ["workbench 0."]), (("rnu",), [])])
def test_help_and_a_mistyped_command_import_no_subcommand(words, shown):
    heavy = {"numpy", "numba", "scipy", "rerun", "hydra", "h5py", "cv2", "pandas"}
    code = f"import sys; from workbench.cli.main import main; main({words}); print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
    assert all(name in done.stdout for name in shown)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "SIGINT"), (Interrupted(SIGTERM), 128 + SIGTERM, "SIGTERM"),
        (Interrupted(SIGINT), 130, "SIGINT"), (OSError(28, "No space left", "run.log"), 1, "run.log: No space left"),
        (DegenerateWeights("frame 3"), 1, "frame 3"),
    ],
)  # fmt: skip
def test_what_ends_a_command_decides_its_exit_code(error, code, words, monkeypatch, capsys):
    def fail():
        raise error

    monkeypatch.setattr(module, "import_module", lambda name: SimpleNamespace(components=fail))
    assert main(["components"]) == code
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    error = ZeroDivisionError("a defect, which shows its traceback")
    with pytest.raises(ZeroDivisionError):
        main(["components"])


@pytest.mark.parametrize(
    "words", ["components", "components prior.smooth", "--help", "run --help", "run --cfg job", "runs list FOLDER",
              "runs list FOLDER --json", "runs list FOLDER --csv"]
)  # fmt: skip
@pytest.mark.slow
def test_a_closed_pipe_ends_a_command_quietly(words, tmp_path):
    """The reader ends before the first line is written."""
    command = [sys.executable, "-m", "workbench", *words.replace("FOLDER", str(tmp_path)).split()]
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert done.stderr == ""
    assert done.returncode == 1
