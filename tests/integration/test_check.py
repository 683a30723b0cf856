"""`workbench check`: repeats stored configurations, compares the results, and refuses unsafe configurations."""

import shutil
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from workbench.cli.main import main
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import current_defaults, runnable_config
from workbench.recording.read.reader import read
from workbench.recording.write.file import RecordingFile
from workbench.results.check import against
from workbench.results.check import rerun as module
from workbench.results.check.agreement import Tolerance
from workbench.results.check.rerun import rerun, tolerances
from workbench.utils.errors import InputError

SMALL = (
    "experiment=walk_straight",
    "dataset.n_frames=4", "dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175",
    "inference.n_particles=60", "recorder.n_particles_shown=5",
)  # fmt: skip

JOINTS = (
    "experiment=walk_keypoints_synthetic", "prior=smooth", "inference=particle_filter", "dataset.n_frames=2",
    "inference.n_particles=20",
)  # fmt: skip


@pytest.fixture(autouse=True)
def empty_working_folder(tmp_path, cache, monkeypatch):
    """Make an empty folder the current one; the cache is that of the session, without real recordings."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)


def resolved(*overrides):
    """Return a configuration as recordings store it."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[*overrides, "paths.data=null", "paths.cache=/home/someone/cache"])
    recorded = [str(key) for key in config if key != "sweep"]
    return OmegaConf.to_yaml(OmegaConf.masked_copy(config, recorded), resolve=True)


@pytest.fixture(scope="module")
def settings():
    """Return the configuration of a small walk."""
    return resolved(*SMALL)


@pytest.fixture(scope="module")
def walk(settings, cache, tmp_path_factory):
    """Return the only recording of a folder of baselines: a small walk."""
    folder = tmp_path_factory.mktemp("baselines")
    config = store(folder / "config.rrd", yaml.safe_load(settings))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORKBENCH_CACHE", str(cache))
        repeated = rerun(config, runnable_config(config, [], current_defaults([])), folder / "run")
    (folder / "config.rrd").unlink()
    (folder / "baselines").mkdir()
    return Path(shutil.move(repeated.path, folder / "baselines" / "walk.rrd"))


def store(path, config, experiment="walk_straight"):
    """Write and read a recording that holds only a configuration."""
    text = config if isinstance(config, str) else yaml.safe_dump(config)
    with RecordingFile(path, run_id="x", config_yaml=text, provenance={"experiment": experiment}):
        pass
    return read(path)


def check(capsys, *arguments, sandboxed=False):
    """Return exit code and output of `workbench check`; sandboxed: the recordings are read in the sandbox first."""
    with pytest.MonkeyPatch.context() as patch:
        if not sandboxed:
            patch.setattr("workbench.recording.read.crash_probe.crashing_recordings", lambda paths, whole=False: set())
        code = main(["check", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out + printed.err


@pytest.mark.slow
def test_an_identical_run_passes(walk, capsys):
    code, output = check(capsys, walk.parent, sandboxed=True)
    assert code == 0, output
    assert output.splitlines()[1].split() == [str(walk), "all", "44", "rounding", "ok", "44", "identical"]
    assert not list(Path.cwd().iterdir())  # temporary files are removed


@pytest.mark.slow
def test_a_change_of_a_constant_by_a_thousandth_fails_with_metric_and_frame(walk, capsys, tmp_path):
    junit = tmp_path / "out.xml"
    code, output = check(capsys, walk, "prior.sigma_phase=0.009009", "--junit", junit)
    assert code == 1
    (metric,) = [line for line in output.splitlines() if "  mpjpe_abs_mm  " in line]
    assert "FAILED (changed) first differs in frame 1: " in metric
    (poses,) = [line for line in output.splitlines() if "  poses  " in line]
    assert "FAILED (changed) poses first differ in frame 1: " in poses
    assert poses.endswith(" mm")
    suite = ET.parse(junit).getroot()
    assert (suite.get("tests"), suite.get("errors")) == ("44", "0")
    failures = {case.get("name"): case[0].get("message") for case in suite if len(case)}
    assert len(failures) == int(suite.get("failures")) > 0
    assert "first differs in frame 1" in failures["mpjpe_abs_mm"]


def test_a_crashed_run_fails_and_the_other_runs_are_checked(walk, capsys, monkeypatch, tmp_path):
    folder = tmp_path / "two"
    folder.mkdir()
    for name in ("a.rrd", "b.rrd"):
        shutil.copy(walk, folder / name)
    execute = module.execute

    def crash_once(config, experiment, folder, quiet):
        monkeypatch.setattr(module, "execute", execute)
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(module, "execute", crash_once)
    code, output = check(capsys, folder)
    assert code == 1
    assert "crashed: ZeroDivisionError: a defect" in output.splitlines()[1]
    assert " ok " in output.splitlines()[2]


@pytest.mark.slow
def test_update_prints_the_changes_and_the_new_recording_passes(walk, capsys, tmp_path):
    path = Path(shutil.copy(walk, tmp_path / "walk.rrd"))
    before = read(path).result["mpjpe_abs_mm"]
    code, output = check(capsys, path, "prior.sigma_phase=0.012", "--update", "--reason", "phases\nspread more")
    assert code == 0
    reasons = (tmp_path / "reasons.md").read_text()
    assert reasons.splitlines()[-1].endswith(": walk: phases spread more")
    after = read(path).result["mpjpe_abs_mm"]
    (line,) = [line for line in output.splitlines() if "  mpjpe_abs_mm  " in line]
    assert line.split()[2:4] == [f"{before:.6g}", f"{after:.6g}"]
    assert read(path).settings["prior"]["sigma_phase"] == 0.012
    assert path.stat().st_size < walk.stat().st_size
    assert sorted(file.name for file in tmp_path.iterdir()) == ["here", "reasons.md", "walk.rrd"]
    updated = path.read_bytes()
    assert "nothing moved" in check(capsys, path, "--update", "--reason", "no change")[1]
    assert path.read_bytes() == updated
    assert (tmp_path / "reasons.md").read_text() == reasons


def test_a_crashed_run_updates_nothing(walk, capsys, tmp_path, monkeypatch):
    path = Path(shutil.copy(walk, tmp_path / "walk.rrd"))
    content = path.read_bytes()
    code, output = check(capsys, path, "inference.n_particles=0", "--update")
    assert (code, "is unchanged: crashed: InputError" in output) == (1, True)
    assert path.read_bytes() == content


@pytest.mark.slow
def test_seeds_compares_distributions(walk, capsys):
    code, output = check(capsys, walk, "--seeds", "4")
    assert code == 0, output
    assert f"{walk}  all 40" in output
    code, output = check(capsys, walk, "--seeds", "2", "dataset.n_frames=3")
    assert code == 1
    assert "means of 1 and 2 seeds differ too much" in output


@pytest.mark.slow
def test_paired_seeds_detect_a_small_change(walk, tmp_path, capsys):
    run = read(walk)
    configs = [runnable_config(run, [f"seed={seed}"], current_defaults([])) for seed in range(1, 5)]
    seeds = [walk, *(rerun(run, config, tmp_path / str(k)).path for k, config in enumerate(configs))]
    code, output = check(capsys, *seeds[:2], "--paired")
    assert code == 0, output
    code, output = check(capsys, walk, "--paired")
    assert (code, "expected recordings of two seeds or more" in output) == (2, True)
    code, output = check(capsys, *seeds, "--paired", "prior.initial_position_std=0.5", "-v")
    assert code == 1
    assert "is detectable" in output


def commit(clone, message):
    author = ("-c", "user.name=a", "-c", "user.email=a@localhost")
    against.git(clone, *author, "commit", "--quiet", "--allow-empty", "--all", "--message", message)


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """Return a clone of this repository whose last commit changes two factors, by rounding and by 0.1 %."""
    folder = tmp_path_factory.mktemp("clones") / "clone"
    try:
        against.git(against.ROOT, "clone", "--quiet", "--no-hardlinks", ".", str(folder))
    except InputError as reason:
        pytest.skip(f"no clone: {reason}")
    package = folder / "workbench"
    for path in (package, folder / "conf"):  # with the uncommitted changes
        shutil.rmtree(path)
        shutil.copytree(against.ROOT / path.name, path, ignore=shutil.ignore_patterns("__pycache__", "conf"))
    against.git(folder, "add", "--all")
    commit(folder, "The current code")
    errors = package / "evaluation" / "errors" / "pose_errors.py"
    text = errors.read_text()
    for metric, factor in (("mpjpe_mm", "1000.000000000001"), ("mpjpe_abs_mm", "1001.0")):
        assert f'"{metric}": 1e3 *' in text
        text = text.replace(f'"{metric}": 1e3 *', f'"{metric}": {factor} *')
    errors.write_text(text)
    commit(folder, "Change two factors")
    (package / "conf").symlink_to("../conf")
    return folder


@pytest.mark.slow
def test_against_another_commit_rounding_passes_and_a_change_of_a_thousandth_fails(
    clone, tmp_path, capsys, monkeypatch
):
    """The check runs in the clone, whose working tree is the last commit."""
    recording = store(tmp_path / "tiny.rrd", resolved(*JOINTS), experiment="walk_keypoints_synthetic").path
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # compiling takes longer
    monkeypatch.setattr("workbench.cli.check.check_against", partial(against.check_against, root=clone))
    code, output = check(capsys, recording, "--against", "HEAD~1", "-o", tmp_path / "made")
    assert code == 1, output
    (line,) = [line for line in output.splitlines() if "  mpjpe_abs_mm  " in line]
    assert "FAILED (changed)" in line
    assert "  mpjpe_mm  " not in output

    def made(runs, request, name, code):
        return [read(tmp_path / "made" / name / "000" / "run.rrd")]

    monkeypatch.setattr(against, "_run_by", made)
    code, output = check(capsys, recording, "--against", "HEAD~1", "--exact")
    assert code == 1, output
    (line,) = [line for line in output.splitlines() if "  mpjpe_mm  " in line]
    assert "FAILED" in line
    assert against.git(clone, "worktree", "list").count("\n") == 1


def test_a_damaged_recording_is_refused_and_the_others_are_checked(walk, capsys, tmp_path):
    folder = tmp_path / "damaged"
    folder.mkdir()
    shutil.copy(walk, folder / "good.rrd")
    (folder / "bad.rrd").write_bytes(walk.read_bytes()[:-300])
    code, output = check(capsys, folder)
    assert code == 2, output
    (line,) = [line for line in output.splitlines() if "REFUSED" in line]
    assert "bad.rrd: expected" in line
    assert "good.rrd  all 44" in output
    assert "Traceback" not in output


def changed(settings, changes):
    config = yaml.safe_load(settings)
    for key, value in changes.items():
        config[key] = {**config.get(key, {}), **value} if isinstance(value, dict) else value
    return config


@pytest.mark.parametrize("changes", [{"recorder": {"path": "link/notes.txt"}}, {"dataset": {"motion": "secret.bvh"}}])
def test_a_stored_configuration_names_no_place_to_write_and_no_file_of_the_current_folder(
    settings, tmp_path, capsys, trusted, changes
):
    """Both commands refuse it; every key is tested in tests/robustness/test_stored_configuration.py."""
    (tmp_path / "elsewhere").mkdir()
    files = [Path("secret.bvh"), tmp_path / "elsewhere" / "notes.txt"]
    for file in files:
        file.write_text("content")
    Path("link").symlink_to(tmp_path / "elsewhere")
    store(tmp_path / "hostile.rrd", changed(settings, changes))
    (place,) = changes
    for words in (["check", f"{tmp_path}/hostile.rrd", "--run"], ["run", f"from={tmp_path}/hostile.rrd"]):
        assert main(words) == 2
        printed = "".join(capsys.readouterr())
        assert f"hostile.rrd: {place}" in printed
        assert "Traceback" not in printed
    assert [file.read_text() for file in files] == ["content"] * 2
    assert sorted(path.name for path in (tmp_path / "elsewhere").iterdir()) == ["notes.txt"]


def test_a_stored_configuration_writes_to_the_users_cache_and_the_folder_of_the_run(settings, tmp_path, cache):
    outside = tmp_path / "outside"
    changes = {"recorder": {"stream": True}, "dataset": {"cache": str(outside)}, "n_threads": 10_000}
    run = store(tmp_path / "hostile.rrd", changed(settings, changes), experiment="../../outside")
    config = runnable_config(run, [], current_defaults([]))
    assert (config.dataset.cache, config.prior.cache, config.paths.cache) == (str(cache),) * 3
    assert (config.recorder.stream, config.n_threads) == (False, None)
    repeated = rerun(run, config, tmp_path / "rerun")
    assert repeated.path == tmp_path / "rerun" / "run.rrd"
    assert not outside.exists()


def test_paths_of_this_machine_replace_the_stored_ones(settings, tmp_path):
    stored = {"paths": {"data": "/home/someone/data/", "cache": "/home/someone/cache"}}
    stored |= {"dataset": {"data": "/home/someone/data/", "motion": "/home/someone/data/mine.bvh"}}
    run = store(tmp_path / "run.rrd", changed(settings, stored))
    defaults = current_defaults(["paths.data=/my/data"])
    config = runnable_config(run, ["paths.data=/my/data"], defaults)
    assert (config.dataset.data, config.dataset.motion) == ("/my/data/", "/my/data/mine.bvh")
    with pytest.raises(InputError, match=r"dataset\.data: .* is outside paths\.data"):
        runnable_config(run, [], current_defaults([]))
    config = runnable_config(run, ["dataset.motion=/elsewhere/x.bvh", "seed=4"], defaults)
    assert (config.dataset.motion, config.seed) == ("/elsewhere/x.bvh", 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere: expected a recording or a folder of recordings, found nothing there"),
        (["seed=3"], "expected recordings (.rrd), found none"),
        (["WALK", "--seeds", "1"], "Invalid value for '--seeds'"),
        (["WALK", "--seeds", "3", "--update"], "--seeds cannot be combined with --update or --record"),
        (["WALK", "--paired", "seed=3"], "--paired uses the recorded seeds"),
        (["WALK", "--against", "HEAD", "--record", "x.rrd"], "cannot be combined with --update or --record"),
        (["WALK", "--against", "no_such"], "no such commit: no_such"),
        (["WALK", "--exact", "--paired"], "--exact cannot be combined"),
        (["WALK", "prior.sigma_fase=1"], "its configuration has no key 'prior.sigma_fase'"),
        (["WALK", "seed=1,2"], "expected key=value with one value"),
    ],
)
def test_wrong_arguments_are_refused(walk, capsys, arguments, message):
    code, output = check(capsys, *[walk if argument == "WALK" else argument for argument in arguments])
    assert code == 2
    assert message in output
    assert "Traceback" not in output


def test_a_tolerances_file_next_to_a_recording_takes_precedence(settings, tmp_path):
    run, defaults = store(tmp_path / "run.rrd", yaml.safe_load(settings)), current_defaults([])
    general, file = tolerances(run, defaults), tmp_path / "tolerances.json"
    file.write_text('{"tolerances": {"run": {"mpjpe_px": 0.25}, "other": {"ess": 1.0}}}')
    assert tolerances(run, defaults) == general | {"mpjpe_px": Tolerance(absolute=0.25)}
    for wrong in ("[]", '{"tolerances": {"run": 3}}', "{"):
        file.write_text(wrong)
        with pytest.raises(InputError, match=r"tolerances\.json: expected"):
            tolerances(run, defaults)
