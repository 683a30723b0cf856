"""What a stranger's folder of options, given by --config-dir, may make Hydra do: nothing but compose."""

import os
import sys
from types import ModuleType

import hydra._internal.hydra as hydra_main
import pytest
from hydra._internal.utils import create_automatic_config_search_path
from hydra.core.config_search_path import SearchPathQuery
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import setup_globals
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.cli.run import main
from workbench.errors import LONGEST, InputError
from workbench.experiment import admission, execute
from workbench.experiment.build import check_targets, resolved
from workbench.experiment.schema import prepare_hydra

HOSTILE = {
    "copies": "hydra: {callbacks: {x: {_target_: shutil.copyfile, src: a, dst: b}}}",
    "saves": "hydra: {callbacks: {x: {_target_: numpy.save, file: a, arr: [1]}}}",
    "opens": "hydra: {callbacks: {x: {_target_: builtins.open, file: a, mode: w}}}",
    "touches": "hydra: {callbacks: {x: {_target_: pathlib.Path.touch, _args_: [a]}}}",
    "fetches": "hydra: {callbacks: {x: {_target_: urllib.request.urlretrieve, url: 'file:///a'}}}",
    "replaces ours": "hydra: {callbacks: {watch: {_target_: numpy.save}}}",
    "adds to ours": "hydra: {callbacks: {watch: {plan: {_target_: numpy.save}}}}",
    "by reference": "protocol: {half: numpy.save}\nhydra: {callbacks: {watch: {_target_: '${protocol.half}'}}}",
    "no mapping": "hydra: {callbacks: {x: [numpy.save]}}",
    "logs elsewhere": "hydra: {job_logging: {handlers: {file: {filename: /tmp/x.log}}}}",
    "logs by a call": "hydra: {job_logging: {handlers: {x: {'()': shutil.copyfile, src: a, dst: b}}}}",
    "formats by a call": "hydra: {hydra_logging: {formatters: {simple: {'()': numpy.save}}}}",
    "formats by a class": "hydra: {job_logging: {formatters: {simple: {class: my.Formatter}}}}",
    "filters by a call": "hydra: {job_logging: {filters: {x: {'()': shutil.copyfile}}}}",
    "sends logs": "hydra: {job_logging: {handlers: {x: {class: logging.handlers.SocketHandler, host: a, port: 1}}}}",
    "takes objects": "hydra: {job_logging: {handlers: {console: {stream: 'ext://os.environ'}}}}",
    "reaches objects": "hydra: {job_logging: {root: {level: 'ext://shutil.rmtree'}}}",
    "names the log": "hydra: {job: {name: ../../x}}",
    "sets variables": "hydra: {job: {env_set: {PYTHONPATH: evil}}}",
    "copies variables": "hydra: {job: {env_copy: [HOME]}}",
    "launches a call": "hydra: {launcher: {_target_: subprocess.run}}",
    "sweeps by a call": "hydra: {sweeper: {_target_: subprocess.run}}",
    "sweeps parts": "hydra: {sweeper: {params: {parts: '[evil]'}}}",
    "sweeps folders": "hydra: {sweeper: {params: {hydra.run.dir: /x}}}",
    "sweeps variables": "hydra: {sweeper: {params: {+hydra.job.env_set.PYTHONPATH: evil}}}",
    "sweeps caches": "hydra: {sweeper: {params: {paths.cache: /x}}}",
    "runs elsewhere": "hydra: {run: {dir: /somewhere/else}}",
    "runs above": "hydra: {run: {dir: a/../../b}}",
    "runs at home": "hydra: {run: {dir: ~/b}}",
    "sweeps elsewhere": "hydra: {sweep: {dir: /somewhere/else}}",
    "resumes elsewhere": "sweep: {resume: /somewhere/else}",
    "keeps elsewhere": "hydra: {output_subdir: ../../x}",
    "works elsewhere": "hydra: {job: {chdir: true}}",
    "forges the command line": "hydra: {overrides: {hydra: [hydra.run.dir=/x]}}",
    "caches elsewhere": "paths: {cache: /somewhere/else}",
    "caches a part elsewhere": "prior: {cache: /somewhere/else}",
    "calls a function of ours": "study: {_target_: workbench.mocap.library.write_library, path: a, motions: []}",
    "calls a command of ours": "study: {_target_: workbench.cli.run.main}",
    "calls a run": "study: {_target_: workbench.experiment.execute.execute}",
    "calls a call within": "defaults: [override /prior: jitter]\nprior: {base: {_target_: workbench.cli.run.main}}",
    "names a list": "prior: {_target_: [workbench.priors.smooth.Smooth]}",
    "names a mapping": "prior: {_target_: {a: b}}",
    "is a list": "prior: [1, 2]",
    "is a text": "dataset: synthetic",
    "refers to itself": "a: &a [x, x]\nb: &b [*a, *a]",
    "is deep": "a: " + "[" * 2000 + "]" * 2000,
    "is python": "a: !!python/object:os.system {}",
    "is a set": "a: !!set {x, y}",
    "is a date": "a: !!timestamp 2026-01-01",
    "is binary": "a: !!binary aGVsbG8=",
    "is a huge number": "seed: 1" + "0" * 5000,
    "is no text": "a: \x00",
    "is long": "a: '" + "x" * 2_000_000 + "'",
}

LAUNCHED = {
    "setup": "_target_: hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher\nsetup: [rm -r x]",
    "more": "additional_parameters: {wrap: rm}\n"
    "_target_: hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher",
    "newline": 'name: "a\\nrm -r x"\n_target_: hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher',
    "folder": "submitit_folder: /x\n_target_: hydra_plugins.hydra_submitit_launcher.submitit_launcher.LocalLauncher",
    "expression": "pre_dispatch: __import__('os')\n"
    "_target_: hydra_plugins.hydra_joblib_launcher.joblib_launcher.JoblibLauncher",
}


@pytest.fixture
def composed(tmp_path, monkeypatch):
    """Compose as `workbench --config-dir=FOLDER` does, where the folder has an experiment `theirs`, and more."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
    setup_globals()
    prepare_hydra()

    def compose(text="", *overrides, name="config", file="experiment/theirs.yaml", data=None):
        path = tmp_path / "theirs" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if data is not None else b"# @package _global_\n" + text.encode())
        search = create_automatic_config_search_path(None, None, "pkg://workbench.conf")
        search.prepend("command-line", f"file://{tmp_path / 'theirs'}", anchor=SearchPathQuery(provider="schema"))
        loader = hydra_main.ConfigLoaderImpl(config_search_path=search)
        said = [] if any(each.startswith("experiment=") for each in overrides) else ["experiment=theirs"]
        return loader.load_configuration(name, [*said, "paths.data=null", *overrides], RunMode.RUN)

    return compose


def refused(compose, *arguments, **keys):
    with pytest.raises((InputError, HydraException, OmegaConfBaseException)) as caught:
        compose(*arguments, **keys)
    if isinstance(caught.value, InputError):
        assert len(str(caught.value)) <= LONGEST


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_file_that_would_act_is_refused_before_hydra_acts(composed, kind):
    refused(composed, HOSTILE[kind])


def test_a_file_does_not_say_where_else_to_look(composed, tmp_path, monkeypatch):
    (tmp_path / "evil").mkdir()
    (tmp_path / "evil" / "__init__.py").write_text("raise SystemExit")
    monkeypatch.syspath_prepend(tmp_path)
    text = b"defaults: [config, _self_]\nhydra: {searchpath: ['pkg://evil']}"
    refused(composed, "", "experiment=custom", name="top", file="top.yaml", data=text)
    assert "evil" not in sys.modules


@pytest.mark.parametrize("kind", LAUNCHED)
def test_a_launcher_of_theirs_runs_nothing(composed, kind):
    text = LAUNCHED[kind].encode()
    refused(composed, "", "experiment=custom", "hydra/launcher=own", file="hydra/launcher/own.yaml", data=text)


def test_a_sweeper_of_theirs_calls_and_writes_nothing(composed):
    for extra in ("custom_search_space: shutil.rmtree", "storage: 'sqlite:////x'", "sampler: {_target_: shutil.rmtree}",
                  "sampler: {_target_: optuna.samplers.TPESampler, gamma: {_target_: shutil.rmtree}}"):  # fmt: skip
        text = f"_target_: hydra_plugins.hydra_optuna_sweeper.optuna_sweeper.OptunaSweeper\n{extra}\n".encode()
        refused(composed, "", "experiment=custom", "hydra/sweeper=own", file="hydra/sweeper/own.yaml", data=text)


def test_bytes_that_are_no_text_are_refused(composed):
    refused(composed, data=b"a: \xff\xfe")


def test_what_stands_on_the_command_line_goes(composed, tmp_path):
    text = "seed: 3\nhydra: {run: {dir: own/folder}, sweeper: {params: {seed: '1,2'}}}"
    config = composed(
        text, f"hydra.run.dir={tmp_path.parent}/x", "+hydra.job.env_set.A=1", f"paths.cache={tmp_path.parent}/c",
        f"sweep.resume={tmp_path.parent}", "hydra.job.chdir=true",
    )  # fmt: skip
    assert (config.seed, dict(config.hydra.job.env_set)) == (3, {"A": "1"})
    assert composed(text).hydra.run.dir == "own/folder"
    for more in ("hydra/launcher=joblib", "hydra/launcher=submitit_slurm", "hydra/sweeper=optuna"):
        composed(text, more)
    launcher = ["hydra/launcher=submitit_slurm", "hydra.launcher.setup=[module load x]", "hydra.launcher.partition=gpu"]
    assert composed(text, *launcher).hydra.launcher.setup == ["module load x"]


def test_a_mapping_on_the_command_line_says_its_own_keys_only(composed):
    text = "hydra: {job: {env_set: {PYTHONPATH: evil}}}"
    refused(composed, text, "+hydra.job.env_set={A: 1}")
    assert dict(composed("", "+hydra.job.env_set={A: 1}").hydra.job.env_set) == {"A": "1"}


@pytest.mark.parametrize("folder", ["x" * 300, "file", "file/below", "/proc/self/x", "/dev/null/x"])
def test_a_folder_that_cannot_be_one_is_refused(composed, tmp_path, folder):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"hydra\.run\.dir"):
        composed("", f"hydra.run.dir={folder}")


@pytest.mark.parametrize("value", ["[" * 3000 + "]" * 3000, "1" * 5000, "{" * 200])
def test_nonsense_on_the_command_line_is_a_sentence(composed, value):
    refused(composed, "", f"seed={value}")


def test_a_file_that_never_ends_is_refused(composed, tmp_path):
    (tmp_path / "theirs" / "experiment").mkdir(parents=True)
    os.mkfifo(tmp_path / "theirs" / "experiment" / "pipe.yaml")
    refused(composed, "", "experiment=pipe")


def test_nothing_is_unpickled(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["workbench", "--experimental-rerun=config.pickle"])
    assert main() == 2
    assert "would unpickle" in capsys.readouterr().err


@pytest.mark.parametrize(
    "target",
    [
        "workbench.mocap.library.write_library", "workbench.experiment.execute.execute", "workbench.cli.run.main",
        "workbench.files.whole_file", "workbench.learning.store.save", "workbench.sweep.job.run_apart",
    ],
)  # fmt: skip
def test_only_what_an_option_names_is_called(target, monkeypatch):
    monkeypatch.setitem(sys.modules, "workbench.cli.run", ModuleType("workbench.cli.run"))  # not to be looked into
    with pytest.raises(InputError, match=r"study\._target_ must name a part"):
        check_targets(OmegaConf.create({"study": {"_target_": target}}))
    with pytest.raises(InputError, match="must name a part"):
        resolved(target)


def test_what_is_not_installed_has_no_classes():
    assert admission._stored("launcher") >= {"hydra._internal.core_plugins.basic_launcher.BasicLauncher"}
    assert admission._stored("a plugin that nobody installed") == set()


@pytest.fixture
def calls(monkeypatch):
    """How often a configuration is composed, with the last one."""
    found = []
    whole = admission.CheckedLoader._checked

    def counted(self, *how):
        found.append(None)
        found[-1] = whole(self, *how)
        return found[-1]

    monkeypatch.setattr(admission.CheckedLoader, "_checked", counted)
    prepare_hydra()
    return found


def shown(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["workbench", *words])
    return main()


def test_one_run_is_composed_once(calls, monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(execute, "execute", lambda config, *_, **__: sys.exit(seen.append(HydraConfig.get())))
    with pytest.raises(SystemExit):
        shown(monkeypatch, f"hydra.run.dir={tmp_path}", "seed=3")
    assert len(calls) == 1
    assert seen[0].mode == RunMode.RUN
    assert seen[0].overrides.task == ["seed=3"]
    assert seen[0].overrides.hydra == [f"hydra.run.dir={tmp_path}", "hydra.mode=RUN"]


def test_a_refused_run_is_composed_once_and_says_the_same(calls, monkeypatch, capsys):
    assert shown(monkeypatch, "inference.n_particles=abc") == 2
    assert "could not be converted" in capsys.readouterr().err
    assert len(calls) == 1


@pytest.mark.parametrize("words", [["seed=1,2"], ["hydra.mode=RUN", "seed=1,2"]])
def test_several_values_without_a_sweep_are_still_refused(calls, monkeypatch, capsys, words):
    assert shown(monkeypatch, *words) == 2
    assert "Ambiguous value" in capsys.readouterr().err
