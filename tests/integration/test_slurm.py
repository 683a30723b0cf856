"""A sweep on a Slurm cluster without accounting: jobs are bound to cores; a killed job is repeated by sweep.resume."""

import getpass
import os
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from workbench.utils.run_files import read_summary
from workbench.utils.run_lock import is_locked

PACKAGES = (
    "slurmctld", "slurmd", "slurm-client", "munge", "slurm-wlm-basic-plugins", "libhwloc15", "liblua5.1-0", "libmunge2",
)  # fmt: skip
PATIENCE_S = 30.0

_CONFIG = """
ClusterName=test
SlurmctldHost=localhost(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
PluginDir={plugins}
SlurmctldPort={port}
SlurmdPort={node_port}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
TaskPlugin=task/affinity
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
SwitchType=switch/none
KillWait=10
ReturnToService=2
SlurmdParameters=config_overrides
NodeName=localhost NodeAddr=127.0.0.1 CPUs={cores} SocketsPerBoard=1 CoresPerSocket={cores} ThreadsPerCore=1
PartitionName=debug Nodes=localhost Default=YES MaxTime=INFINITE State=UP
"""


class SlurmError(Exception):
    """Raised where no Slurm cluster can be started."""


def unpack(folder: Path) -> Path:
    """Download Debian's packages and unpack them below `folder`; raise SlurmError where they are not available."""
    if missing := [name for name in ("apt-get", "dpkg", "setpriv") if shutil.which(name) is None]:
        raise SlurmError(f"no {missing[0]}")
    download = subprocess.run(
        ["apt-get", "download", *PACKAGES], cwd=folder, capture_output=True, text=True, check=False
    )
    if download.returncode != 0:
        raise SlurmError(f"Debian's packages are not available: {' '.join(download.stderr.split())[:200]}")
    for package in folder.glob("*.deb"):
        subprocess.run(["dpkg", "-x", package, folder / "root"], check=True)
    return folder / "root"


@contextmanager
def cluster(folder: Path) -> Iterator[dict[str, str]]:
    """Start a cluster of this machine's cores; yield the environment in which Slurm's commands reach it.

    The cluster binds jobs to cores and has no accounting, so that `sacct` prints nothing.
    """
    root = unpack(folder)
    libraries = next((root / "usr" / "lib").glob("*-linux-gnu"))
    state = folder / "cluster"
    for name in ("state", "spool"):
        (state / name).mkdir(parents=True)
    (state / "key").write_bytes(secrets.token_bytes(1024))
    (state / "key").chmod(0o400)
    (state / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
    ports = dict(zip(("port", "node_port"), free_ports(2), strict=True))
    names = {"user": getpass.getuser(), "folder": state, "plugins": libraries / "slurm-wlm", "cores": os.cpu_count()}
    (state / "slurm.conf").write_text(_CONFIG.format(**names, **ports))
    environment = {
        **os.environ,
        "PATH": f"{root / 'usr' / 'bin'}:{os.environ['PATH']}",
        "LD_LIBRARY_PATH": f"{libraries}:{libraries / 'slurm-wlm'}",
        "SLURM_CONF": str(state / "slurm.conf"),
    }
    programs = root / "usr" / "sbin"
    munge = [programs / "munged", "--foreground", "--force", *(f"--{name}={state / file}" for name, file in _MUNGE)]
    with ExitStack() as stack:
        for command in (
            munge,
            [programs / "slurmctld-wlm", "-D", "-i"],
            [programs / "slurmd-wlm", "-D", "-N", "localhost", "-d", programs / "slurmstepd-wlm"],
        ):
            stack.enter_context(_running(command, environment, state))
        _wait_until_idle(environment, state)
        try:
            yield environment
        finally:
            _cancel_all(environment)


_MUNGE = (("key-file", "key"), ("socket", "munge.socket"), ("pid-file", "munge.pid"), ("seed-file", "munge.seed"),
          ("log-file", "munge.log"))  # fmt: skip


@contextmanager
def _running(command: Sequence[str | Path], environment: dict[str, str], folder: Path) -> Iterator[None]:
    with (folder / "out.log").open("ab") as out:
        command = ["setpriv", "--pdeathsig", "TERM", *command]  # also ends when the test is killed
        process = subprocess.Popen(command, env=environment, stdout=out, stderr=subprocess.STDOUT)
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait_until_idle(environment: dict[str, str], folder: Path) -> None:
    end = time.monotonic() + PATIENCE_S
    while "idle" not in (states := slurm(environment, "sinfo", "--noheader", "--format=%T")):
        if time.monotonic() > end:
            reason = states.strip() or (folder / "out.log").read_text()[-300:]
            raise SlurmError(f"its node is not idle after {PATIENCE_S:g} s: {reason}")
        time.sleep(0.2)


def _cancel_all(environment: dict[str, str]) -> None:
    slurm(environment, "scancel", "--user", getpass.getuser(), "--signal=KILL")
    slurm(environment, "scancel", "--user", getpass.getuser())
    end = time.monotonic() + PATIENCE_S
    while slurm(environment, "squeue", "--noheader").strip() and time.monotonic() < end:
        time.sleep(0.2)


def slurm(environment: dict[str, str], *command: str) -> str:
    """Return the output of one of Slurm's commands."""
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False).stdout


def free_ports(n: int) -> list[int]:
    """Return unused ports of the loopback interface."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(n)]
        for unbound in sockets:
            unbound.bind(("127.0.0.1", 0))
        return [bound.getsockname()[1] for bound in sockets]


N_JOBS = 2
JOBS = (
    "experiment=walk_straight", "paths.data=null", f"seed=range({N_JOBS})", "dataset.n_frames=40",
    "inference.n_particles=1500", "dataset.width=160", "dataset.height=120", "dataset.person_px=80",
    "dataset.focal_px=175",
)  # fmt: skip
LAUNCHER = ("hydra/launcher=submitit_slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.timeout_min=20")
JOBS_PATIENCE_S = 600.0


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Yield the environment in which Slurm's commands reach a cluster on this machine."""
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
    try:
        with cluster(tmp_path_factory.mktemp("slurm")) as variables:
            yield variables
    except SlurmError as reason:
        pytest.skip(f"no Slurm: {reason}")


@pytest.mark.slow
def test_a_sweep_on_slurm_is_completed_after_a_job_was_killed(tmp_path, environment):
    """Without accounting, submitit waits for a killed job until it is interrupted."""
    sweep, output = tmp_path / "sweep", tmp_path / "output.txt"
    environment = {**environment, "WORKBENCH_CACHE": str(tmp_path / "cache")}
    environment.pop("NUMBA_NUM_THREADS", None)  # a job uses as many threads as it has cores
    command = [sys.executable, "-m", "workbench", "run", "-m", *LAUNCHER, *JOBS]
    with output.open("w") as out, subprocess.Popen(
        [*command, f"hydra.sweep.dir={sweep}"], cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT
    ) as process:  # fmt: skip
        wait_for(lambda: (sweep / "0" / "run.rrd.part").is_file() and is_locked(sweep / "0"), output)
        assert len(os.sched_getaffinity(process_of(sweep / "0"))) == 1
        os.kill(process_of(sweep / "0"), signal.SIGKILL)  # as the kernel does when memory is exhausted
        wait_for(lambda: not slurm(environment, "squeue", "--noheader").strip(), output)
        process.send_signal(signal.SIGINT)
    printed = output.read_text()
    assert process.returncode == 128 + signal.SIGINT, printed
    assert f"1 of {N_JOBS} jobs are not complete" in printed
    assert f"{sweep / '0'}: killed" in printed
    assert (sweep / "0" / "run.rrd.part").is_file()

    before = [read_summary(sweep / str(job))["started"] for job in range(N_JOBS)]
    completed = subprocess.run([*command, f"sweep.resume={sweep}"], cwd=tmp_path, env=environment, check=False)
    assert completed.returncode == 0
    after = [read_summary(sweep / str(job)) for job in range(N_JOBS)]
    unchanged = [summary["started"] == started for summary, started in zip(after, before, strict=True)]
    assert unchanged == [False, True]
    assert all(summary["status"] == "complete" for summary in after)


def wait_for(condition, output):
    end = time.monotonic() + JOBS_PATIENCE_S
    while not condition():
        assert time.monotonic() < end, output.read_text()
        time.sleep(0.1)


def process_of(folder: Path) -> int:
    """Return the number of the process that runs in a folder."""
    return int(re.search(r"process (\d+)", (folder / ".lock").read_text())[1])
