"""Configurations that a stranger may have written: numbers, names, files and folders that no run can have."""

import pytest
from in_a_fork import call

from workbench.cli.run import main

WORDS = (
    "dataset.focal_px=-1e308", "dataset.focal_px=nan", "dataset.focal_px=inf", "dataset.focal_px=0",
    "dataset.view_deg=inf", "dataset.noise=1e308", "dataset.noise=nan",
    "dataset.width=20000 dataset.height=20000 dataset.n_frames=1000", "dataset.n_frames=9223372036854775808",
    "dataset.rate_hz=1e-308", "seed=-9223372036854775808", "seed=18446744073709551616", "threads=1000000000",
    "inference.n_particles=1000000000", "likelihood.n_samples=1000000000", "likelihood.sigma=inf",
    "likelihood.epsilon=1", "likelihood.k=-1e308", "likelihood.blur_px=1e308", "prior.n_components=1000000000",
    "prior.sigma_position=[1e308,0,0]", "prior.sigma_phase=-inf", "prior.sigma_coefficients=nan",
    "dataset.departures={camera:1e308}", "dataset.departures={start_m:nan}", "dataset.departures={what:1}",
    "recorder.marginal_bins=-1", "recorder.n_particles_shown=-1", "recorder.jpeg_quality=-1",
    "inference=fixed_lag inference.lag=1000000000", "inference=annealed inference.move.layers=1000000000",
    "inference=tempered_smc inference.move.moves=1000000000",
    "inference=backward_simulation inference.n_paths=1000000", "dataset.motion=/dev/zero",
    "dataset.motion=/dev/zero.bvh", "dataset.motion=[[[[builtin]]]]", "dataset.motion=[]",
    "dataset.motion=../../../../etc/passwd", "learn.motions=/dev/zero", "learn.motions=pipe",
    "dataset.camera=/dev/zero", "dataset.camera=pipe", "dataset.camera=folder", "paths.cache=/dev/null",
    "hydra.run.dir=/proc/self/x", "hydra.run.dir=/dev/null", "hydra.run.dir=/dev/null/x",
    "dataset.motion=${dataset.motion}", "seed=${seed}", "learn.motions=${oc.env:PATH}",
    "learn.motions=${oc.decode:${oc.env:PATH}}", "learn.motions=${nothing:1}",
    "learn.motions=${given:${given:${given:1,2,3},2,3},2,3}", "learn.motions=${learn}", "prior=${dataset}",
    "dataset=${prior}", "inference=${oc.create:{_target_:os.system}}", "study={_target_:os.system,command:id}",
    "+prior.x={_target_:subprocess.run,args:[id]}", "prior._target_=builtins.eval", "prior._target_=workbench.priors",
    "prior._target_=workbench.limits.check_sizes", "prior._partial_=true", "+prior._args_=[1]", "+prior._convert_=x",
    "hydra.job.name=../../../x", "hydra.job_logging.handlers.file.filename=/dev/full",
    "hydra.callbacks.watch._target_=os.system", "parts=[os]", "parts=[../x]", "parts=[workbench.cli]", "parts=[\"\"]",
    "from=/dev/zero", "from=pipe", "from=folder", "from=empty", "from=empty@99999999999999999999999", "from=empty@-1",
    "from=empty@nan", "--config-dir=/dev/zero", "--config-dir=pipe", "--config-name=../../../etc/passwd",
    "--config-path=/dev", "--info=x", "--cfg=x", "sweep.stop_when=__import__(os)", "sweep.stop_when=1>0>",
    "sweep.jobs=[-5] -m", "seed=range(0,1000000000000) -m", "seed=range(0,1e308) -m",
    "seed=choice() -m", "seed=interval(0,inf) -m", "sweep.resume=/dev/null -m",
    "dataset.occluder=maybe", "dataset.moving=[x]", "dataset.path=spiral", "body=height body.height_m=1e308",
    "body=height body.height_m=1.7 +body.lengths={thigh:nan}", "seed=shuffle(range(0,1000000000000)) -m",
    "seed=range(0,1000) inference.n_particles=range(1,1000) -m",
    "hydra/sweeper=optuna hydra.sweeper.n_trials=1000000000000 seed=range(0,5) -m",
    f"seed={'9' * 5000}", f"seed={'[' * 3000}{']' * 3000}",
    "inference.n_particles=10,1000000000 -m", "dataset.focal_px=nan,1 -m",
    "sweep.stop_when=error_px>nan -m", "sweep.stop_when=error_px>1e999 -m",
    "hydra.sweeper.max_batch_size=0 seed=0,1 -m",
    "hydra/launcher=joblib hydra.launcher.n_jobs=1000000000 -m", "hydra/launcher=joblib hydra.launcher.n_jobs=0 -m",
    *(f"hydra/sweeper=optuna {words} -m" for words in (
        "hydra.sweeper.n_trials=-5", "hydra.sweeper.n_trials=0", "hydra.sweeper.n_trials=1.5",
        "hydra.sweeper.n_jobs=1000000000", "hydra.sweeper.n_jobs=0", "hydra.sweeper.max_failure_rate=nan",
        "hydra.sweeper.sampler.seed=-1", "hydra.sweeper.sampler.n_ei_candidates=1000000000000",
        "inference.n_particles=interval(1,1e300)", "dataset.n_frames=choice(1000000000,2000000000)",
    )),
)  # fmt: skip
ABSURD = (
    "dataset.focal_px=1e308", "seed=range(0,1000000000000) -m", "hydra.run.dir=/proc/self/x",
    "inference.n_particles=10,1000000000 -m", f"seed={'9' * 5000}",
)  # fmt: skip
LAUGHS = "people:\n  walk: x\n" + "".join(
    f"  {name}: '{f'${{people.{before}}}' * 20}'\n"
    for before, name in (("walk", "run"), ("run", "walks"), ("walks", "library"))
)
THEIRS = {
    "twenty times the one before": LAUGHS,
    "in one another": "learn: {motions: '" + "${given:" * 400 + "a" + ",b,c}" * 400 + "'}",
    "hexadecimal": "seed: 0x" + "f" * 6000, "sexagesimal": "seed: " + ":".join(["59"] * 5000),
    "many keys": "people:\n" + "".join(f"  k{k}: 1\n" for k in range(60_000)),
    "more jobs than anybody runs": "hydra: {sweeper: {params: {seed: 'range(0,1000000000000)'}}}",
    "of particular parts": "when: {prior.walking: {sigma_phase: 1.0e+308}}", "itself": "defaults: [theirs]",
    "another file": "defaults: [{override /prior: ../../../etc/passwd}]", "threads": "threads: 1.0e+308",
    "a condition": "sweep: {stop_when: '" + "a" * 100_000 + ">'}", "a dotted key": "a.b.c.d: 1", "a number": "1: 2",
}  # fmt: skip
SOON_S = 5.0
MOST_MB = 1000


def of_few_letters(words):
    return words[:80]


def refused(words, folder):
    """Seconds of the processor count, of which the imports of the parts of a run are most."""
    ended = call(main, words, SOON_S, folder)
    assert ended.code == 2, ended
    assert "Traceback" not in ended.told
    assert ended.told.strip(), "nothing is said"
    assert max(len(line) for line in ended.told.splitlines()) < 400
    assert ended.cpu_s < SOON_S
    assert ended.most_mb < MOST_MB
    return ended.told


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty").touch()
    return tmp_path


@pytest.mark.parametrize("words", ABSURD, ids=of_few_letters)
def test_what_is_absurd_is_refused_soon(words, folder):
    refused(words.split(), folder)


@pytest.mark.slow
@pytest.mark.parametrize("words", WORDS, ids=of_few_letters)
def test_what_no_run_can_have_is_refused_soon(words, folder):
    refused(words.split(" "), folder)


@pytest.mark.slow
@pytest.mark.parametrize("kind", THEIRS)
def test_a_file_of_theirs_is_refused_soon(kind, folder):
    path = folder / "theirs" / "experiment" / "theirs.yaml"
    path.parent.mkdir(parents=True)
    path.write_text("# @package _global_\n" + THEIRS[kind] + "\n")
    sweep = ["-m"] if "sweeper" in THEIRS[kind] else []
    refused([f"--config-dir={folder / 'theirs'}", "experiment=theirs", *sweep], folder)
