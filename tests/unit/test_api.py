"""The Python API: runs by experiment, components built in Python, and their classes in the recording."""

import json
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from compositions import composed

import workbench as wb
from workbench.experiment.config.stored import runnable_config
from workbench.likelihoods.uniform import Uniform
from workbench.priors.ar_offsets import AROffsets
from workbench.utils.errors import InputError

SMALL = (
    "dataset.n_frames=3", "dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175",
    "inference.n_particles=20", "recorder.n_particles_shown=5", "recorder.marginal_bins=8",
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def no_recorded_motions(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("WORKBENCH_DATA", raising=False)
        patch.setenv("WORKBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def run_with_own_prior(tmp_path_factory):
    """Return a run whose prior is a class that replaces its experiment's, and its folder."""
    folder = tmp_path_factory.mktemp("runs") / "own_prior"
    prior = partial(AROffsets, base=partial(wb.Smooth, damping=2.0), ar_coefficient=0.5, sigma=0.01)
    return wb.run("walk_prior_only", "seed=3", *SMALL, folder=folder, quiet=True, prior=prior), folder


def built_components(n_frames=3):
    clip = wb.FrameCache(wb.Synthetic(n_frames=n_frames, width=160, height=120, person_px=80.0, focal_px=175.0))
    prior = wb.Smooth(damping=1.5, sigma={"root_x": 0.02})
    body = wb.person(clip.info.shape)
    return wb.Components(clip, body, prior, wb.ParticleFilter(prior, Uniform(), n_particles=20), clip.info.initial_pose)


def test_a_run_has_its_folder_and_records_its_own_prior(run_with_own_prior):
    run, folder = run_with_own_prior
    assert run.folder == folder
    assert {path.name for path in folder.iterdir()} == {".lock", "run.rrd", "summary.json"}
    assert run.status == "complete"
    assert run.settings["seed"] == 3
    prior = run.settings["prior"]
    assert (prior["_target_"], prior["ar_coefficient"]) == ("workbench.priors.ar_offsets.AROffsets", 0.5)
    assert (prior["base"]["_target_"], prior["base"]["damping"]) == ("workbench.priors.smooth.Smooth", 2.0)
    assert prior["base"]["initial_pose_scale"] == 2.0  # a default of the class
    assert "prior=AROffsets" in run.provenance["choices"]
    command = run.provenance["command"]
    assert command.startswith("workbench.run('walk_prior_only', 'seed=3'")
    assert (
        "prior=partial(workbench.priors.ar_offsets.AROffsets, base=partial(workbench.priors.smooth.Smooth, damping=2.0)"
        in command
    )
    assert json.loads((folder / "summary.json").read_text())["settings"]["prior"] == prior


def test_components_built_in_python_are_recorded(tmp_path, capsys):
    components = built_components()
    run = wb.record(components, tmp_path / "out", seed=5)
    assert capsys.readouterr().out == f"written to {tmp_path / 'out'}\n"
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"] == "complete"
    recorded = {"body": "workbench.body.limbs.Body", "dataset": "workbench.datasets.synthetic.Synthetic"}
    recorded |= {"prior": "workbench.priors.smooth.Smooth", "likelihood": "workbench.likelihoods.uniform.Uniform"}
    recorded |= {"inference": "workbench.inference.smc.particle_filter.ParticleFilter"}
    assert run.settings["seed"] == 5
    assert {group: run.settings[group] for group in recorded} == {
        group: {"_target_": name} for group, name in recorded.items()
    }
    with pytest.raises(InputError, match=r"run.rrd: its components were built in Python"):
        runnable_config(run, [], composed("experiment=custom"))
    tracked = np.array([step.expected_pose for step, _ in wb.track(built_components(), seed=5)])
    np.testing.assert_array_equal(run.poses[1], tracked)


def test_a_run_without_a_folder_gets_the_default_folder_and_prints_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run = wb.record(built_components(2))
    assert run.folder.parent == Path("recordings", "runs", "python")
    assert f"written to {run.folder}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "components", "message"),
    [
        (("walk_nowhere",), {}, "Could not find 'experiment/walk_nowhere'"),
        (("walk_straight", "seeed=3"), {}, "Could not override 'seeed'"),
        (("walk_straight",), {"priors": wb.Smooth}, "expected a component by its group, .* found 'priors'"),
        (("walk_straight",), {"prior": "smooth"}, "prior: expected a class, or functools.partial"),
        (("walk_straight",), {"prior": partial(wb.Smooth, ("root_x",))}, "prior: expected a class, or functools.part"),
        (("walk_straight",), {"prior": partial(wb.Smooth, dampin=1.0)}, "Smooth has no key 'dampin'; it has"),
        (("walk_straight",), {"prior": partial(wb.Smooth, damping="much")}, "damping"),
        (("walk_straight",), {"prior": Path}, "expected a component of the workbench"),
    ],
)  # fmt: skip
def test_invalid_arguments_are_rejected_in_one_message(arguments, components, message, tmp_path):
    with pytest.raises(InputError, match=message):
        wb.run(*arguments, folder=tmp_path / "out", **components)


def test_an_error_names_the_runs_folder(tmp_path):
    components = built_components()
    broken = wb.Components(components.clip, components.body, components.prior, components.inference, None)
    with pytest.raises(InputError, match="needs a pose to start from") as error:
        wb.record(broken, tmp_path / "out")
    assert error.value.__notes__ == [f"the run's folder: {tmp_path / 'out'}"]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"] == "failed"


def test_importing_the_workbench_imports_no_heavy_package():
    code = "import sys, workbench; print({'numpy', 'hydra', 'rerun', 'numba', 'pandas', 'polars'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_every_public_name_is_callable_and_not_replaced_by_a_package():
    import workbench.results.table
    import workbench.sweep.table  # noqa: F401 (this sets attributes of the package)

    for name in wb.__all__:
        assert callable(getattr(wb, name)), name
    assert set(wb.__all__) <= set(dir(wb))


def test_a_run_is_checked_against_its_baseline(run_with_own_prior, tmp_path, trusted):
    run, baseline = run_with_own_prior[0], tmp_path / "baselines" / "own.rrd"
    with pytest.raises(InputError, match=r"own\.rrd: is no baseline yet"):
        wb.check(run, baseline)
    assert wb.check(run, baseline, update=True).passed
    content = baseline.read_bytes()
    assert wb.check(run, baseline).passed
    wb.check(run, baseline, update=True)
    assert baseline.read_bytes() == content  # an equal baseline stays
    other = wb.run("walk_prior_only", "seed=4", *SMALL, folder=tmp_path / "other", quiet=True)
    with pytest.raises(AssertionError, match=r"mpjpe_mm.+FAILED \(changed\)(.|\n)+seed: 3 → 4"):
        wb.check(other, baseline)
    wb.check(other, baseline, update=True)
    assert wb.check(other, baseline).passed
    baseline.write_bytes(b"no recording")
    with pytest.raises(InputError, match=r"own\.rrd"):
        wb.check(run, baseline)


@pytest.mark.slow
def test_a_run_from_python_is_identical_to_that_of_the_command(tmp_path):
    from workbench.cli.main import main

    small = [*SMALL, "seed=4"]
    run = wb.run("walk_straight", *small, folder=tmp_path / "python", quiet=True)
    assert main(["run", "experiment=walk_straight", *small, f"hydra.run.dir={tmp_path / 'cli'}"]) == 0
    expected = wb.read(tmp_path / "cli")
    assert expected.provenance["identity"] == run.provenance["identity"]
    assert expected.provenance["choices"] == run.provenance["choices"]
    np.testing.assert_array_equal(expected.poses[1], run.poses[1])
    assert expected.result == run.result


def test_settings_of_hydra_are_rejected_with_the_parameter(tmp_path):
    with pytest.raises(InputError, match=r"hydra\.run\.dir=x: .*set the folder by folder="):
        wb.run("walk_straight", "hydra.run.dir=x", folder=tmp_path)
