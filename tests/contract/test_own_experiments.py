"""A copy of an experiment in a user's folder composes to the same configuration, and errors name its file."""

import json
import re
import subprocess
import sys

import pytest
from compositions import composed
from omegaconf import OmegaConf

from workbench.cli.main import main
from workbench.experiment.config import options as options_module
from workbench.experiment.config.schema import composed as compose
from workbench.utils.run_files import SUMMARY

FILES = [
    options_module.folder(options_module.OURS) / "experiment" / f"{name}.yaml"
    for name in ("points_walk_steady", "held_out_subjects", "walk_multi_cue")
]
SMALL = (
    "dataset.n_frames=3", "dataset.width=80", "dataset.height=60", "dataset.person_px=40", "dataset.focal_px=90",
    "inference.n_particles=20",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a user's folder, as if passed by --config-dir."""
    monkeypatch.setattr(options_module, "_config_dirs", [tmp_path])
    (tmp_path / "experiment").mkdir()
    return tmp_path


def resolved(*overrides):
    config = compose(["paths.data=somewhere", *overrides], with_hydra=True)
    parameters = OmegaConf.to_container(config.hydra.sweeper.get("params") or OmegaConf.create({}))
    settings = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
    return OmegaConf.to_container(settings, resolve=True), parameters


@pytest.mark.parametrize("original", FILES, ids=lambda path: path.stem)
@pytest.mark.slow
def test_a_copy_is_the_same_experiment(folder, original):
    text = original.read_text(encoding="utf-8")
    (folder / "experiment" / "copied.yaml").write_text(text, encoding="utf-8")
    for paper in ("ours", "literal") if "paper.literal" in text else ("ours",):
        copied = resolved("experiment=copied", f"paper={paper}")
        assert copied == resolved(f"experiment={original.stem}", f"paper={paper}")


def test_an_experiment_extends_another_of_the_folder_and_an_own_option_has_the_keys_of_its_class(folder):
    (folder / "prior").mkdir()
    (folder / "prior" / "stiff.yaml").write_text("_target_: workbench.priors.smooth.Smooth\n# Stiff.\nsigma: 0.25\n")
    (folder / "experiment" / "base.yaml").write_text(
        "# @package _global_\ndefaults: [walk_straight, override /prior: stiff]\n"
        "if_chosen: {prior.stiff: {damping: 7.0}}\n"
    )
    (folder / "experiment" / "mine.yaml").write_text("# @package _global_\ndefaults: [base]\nseed: 3\n")
    config = compose(["experiment=mine"])
    assert (config.seed, config.prior.sigma, config.prior.damping) == (3, 0.25, 7.0)
    assert set(config.prior) == set(composed("prior=smooth", "experiment=custom").prior)


ERRORS = {
    "defaults: [override /prior: ar_ofsets]": r"prior: there is no option 'ar_ofsets'; did you mean prior=ar_offsets",
    "prior: {no_such: 1}": r"the chosen prior \(walking\) has no key prior\.no_such",
    "liklihood: {k: 1}": r"there is no key liklihood; did you mean likelihood",
    "seed: [1]": r"Value '\[1\]' .* could not be converted to Integer",
    "prior: {_target_: os.system}": r"config: expected a component of the workbench, found 'os\.system'",
    "prior: {_target_: workbench.priors.smooth.Smooth, x: 1}": r"workbench\.priors\.smooth\.Smooth has no key 'x'",
    "if_chosen: {prior.nothing: {a: 1}}": r"if_chosen: there is no component prior\.nothing",
    "if_chosen: {prior.walking: 3}": r"if_chosen: prior\.walking: expected keys and values, found 3",
    "prior: [": r"expected YAML: ",
    "\0": r"expected a text file",
}


@pytest.mark.parametrize("text", ERRORS)
@pytest.mark.slow
def test_an_error_in_the_folder_is_one_message_with_the_file(folder, capsys, text):
    file = folder / "experiment" / "mine.yaml"
    file.write_text(f"# @package _global_\n{text}\n", encoding="utf-8")
    assert main(["run", "--config-dir", str(folder), "experiment=mine"]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert re.match(rf"workbench: {re.escape(str(file))}: {ERRORS[text]}", last)


def test_an_experiment_with_the_name_of_an_existing_one_is_rejected(folder):
    (folder / "experiment" / "walk_circle.yaml").write_text("# @package _global_\nseed: 1\n")
    with pytest.raises(ValueError, match=r"experiment/walk_circle\.yaml: expected one file, found"):
        compose(["experiment=walk_circle"])


@pytest.mark.slow
def test_a_copy_runs_as_a_single_run_and_in_a_launchers_worker(folder, tmp_path, cache, monkeypatch):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    original = options_module.folder(options_module.OURS) / "experiment" / "walk_circle.yaml"
    (folder / "experiment" / "mine.yaml").write_text(original.read_text(encoding="utf-8"), encoding="utf-8")
    arguments = ["run", f"--config-dir={folder}", "experiment=mine", *SMALL]
    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    assert main([*arguments, f"hydra.run.dir={tmp_path / 'single'}"]) == 0
    worker = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "hydra.sweep.dir=sweep"]
    command = [sys.executable, "-m", "workbench", *arguments, "-m", "seed=0", *worker]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    summaries = [json.loads((tmp_path / run / SUMMARY).read_text()) for run in ("single", "sweep/0")]
    assert [summary["experiment"] for summary in summaries] == ["mine"] * 2
    for metric in ("mpjpe_abs_mm", "mpjpe_px"):
        assert summaries[0]["metrics"][metric] == summaries[1]["metrics"][metric]
