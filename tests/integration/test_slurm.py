"""A sweep over a real Slurm without accounting: jobs bound to cores, one killed and run again."""

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

from workbench.sweep.job import read_summary
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
AuthInfo=socket={place}/munge.socket
CredType=cred/munge
PluginDir={plugins}
SlurmctldPort={port}
SlurmdPort={node_port}
SlurmctldPidFile={place}/slurmctld.pid
SlurmdPidFile={place}/slurmd.pid
StateSaveLocation={place}/state
SlurmdSpoolDir={place}/spool
SlurmctldLogFile={place}/slurmctld.log
SlurmdLogFile={place}/slurmd.log
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
    """Why there is no Slurm."""


def unpack(folder: Path) -> Path:
    """Download Debian's packages and unpack them below `folder`; raises SlurmError where they cannot be had."""
    if lacking := [name for name in ("apt-get", "dpkg", "setpriv") if shutil.which(name) is None]:
        raise SlurmError(f"no {lacking[0]}")
    done = subprocess.run(["apt-get", "download", *PACKAGES], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SlurmError(f"Debian's packages cannot be had: {' '.join(done.stderr.split())[:200]}")
    for package in folder.glob("*.deb"):
        subprocess.run(["dpkg", "-x", package, folder / "root"], check=True)
    return folder / "root"


@contextmanager
def cluster(folder: Path) -> Iterator[dict[str, str]]:
    """Start a cluster of this machine's cores; gives the environment in which Slurm's commands reach it.

    It has no accounting, so that `sacct` answers nothing, and binds jobs to cores. Raises SlurmError where there can be
    none.
    """
    root = unpack(folder)
    libraries = next((root / "usr" / "lib").glob("*-linux-gnu"))
    place = folder / "cluster"
    for name in ("state", "spool"):
        (place / name).mkdir(parents=True)
    (place / "key").write_bytes(secrets.token_bytes(1024))
    (place / "key").chmod(0o400)
    (place / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
    ports = dict(zip(("port", "node_port"), free_ports(2), strict=True))
    names = {"user": getpass.getuser(), "place": place, "plugins": libraries / "slurm-wlm", "cores": os.cpu_count()}
    (place / "slurm.conf").write_text(_CONFIG.format(**names, **ports))
    environment = {
        **os.environ,
        "PATH": f"{root / 'usr' / 'bin'}:{os.environ['PATH']}",
        "LD_LIBRARY_PATH": f"{libraries}:{libraries / 'slurm-wlm'}",
        "SLURM_CONF": str(place / "slurm.conf"),
    }
    programs = root / "usr" / "sbin"
    munge = [programs / "munged", "--foreground", "--force", *(f"--{name}={place / file}" for name, file in _MUNGE)]
    with ExitStack() as stack:
        for command in (
            munge,
            [programs / "slurmctld-wlm", "-D", "-i"],
            [programs / "slurmd-wlm", "-D", "-N", "localhost", "-d", programs / "slurmstepd-wlm"],
        ):
            stack.enter_context(_running(command, environment, place))
        _wait_until_idle(environment, place)
        try:
            yield environment
        finally:
            _cancel_all(environment)


_MUNGE = (("key-file", "key"), ("socket", "munge.socket"), ("pid-file", "munge.pid"), ("seed-file", "munge.seed"),
          ("log-file", "munge.log"))  # fmt: skip


@contextmanager
def _running(command: Sequence[str | Path], environment: dict[str, str], place: Path) -> Iterator[None]:
    with (place / "out.log").open("ab") as out:
        command = ["setpriv", "--pdeathsig", "TERM", *command]  # when the test itself is killed
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


def _wait_until_idle(environment: dict[str, str], place: Path) -> None:
    end = time.monotonic() + PATIENCE_S
    while "idle" not in (told := slurm(environment, "sinfo", "--noheader", "--format=%T")):
        if time.monotonic() > end:
            words = told.strip() or (place / "out.log").read_text()[-300:]
            raise SlurmError(f"its node is not idle after {PATIENCE_S:g} s: {words}")
        time.sleep(0.2)


def _cancel_all(environment: dict[str, str]) -> None:
    slurm(environment, "scancel", "--user", getpass.getuser(), "--signal=KILL")
    slurm(environment, "scancel", "--user", getpass.getuser())
    end = time.monotonic() + PATIENCE_S
    while slurm(environment, "squeue", "--noheader").strip() and time.monotonic() < end:
        time.sleep(0.2)


def slurm(environment: dict[str, str], *command: str) -> str:
    """What one of Slurm's commands prints."""
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False).stdout


def free_ports(n: int) -> list[int]:
    """Ports of loopback that nobody listens at."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(n)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


N_JOBS = 4
JOBS = (
    "experiment=walk_straight", "paths.data=null", f"seed=range({N_JOBS})", "dataset.n_frames=40",
    "inference.n_particles=3000", "dataset.width=160", "dataset.height=120", "dataset.person_px=80",
    "dataset.focal_px=175",
)  # fmt: skip
LAUNCHER = ("hydra/launcher=submitit_slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.timeout_min=20")
JOBS_PATIENCE_S = 600.0


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """In which Slurm's commands reach a cluster on this machine."""
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
    try:
        with cluster(tmp_path_factory.mktemp("slurm")) as found:
            yield found
    except SlurmError as reason:
        pytest.skip(f"no Slurm: {reason}")


@pytest.mark.slow
def test_a_sweep_over_slurm_is_completed_after_a_job_was_killed(tmp_path, environment):
    """Without accounting submitit waits for a killed job until it is interrupted itself."""
    sweep, output = tmp_path / "sweep", tmp_path / "output.txt"
    environment = {**environment, "WORKBENCH_CACHE": str(tmp_path / "cache")}
    environment.pop("NUMBA_NUM_THREADS", None)  # the cores that Slurm binds a job to say how many
    command = [sys.executable, "-m", "workbench", "run", "-m", *LAUNCHER, *JOBS]
    with output.open("w") as out, subprocess.Popen(
        [*command, f"hydra.sweep.dir={sweep}"], cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT
    ) as process:  # fmt: skip
        wait_for(lambda: (sweep / "0" / "run.rrd.part").is_file() and is_locked(sweep / "0"), output)
        assert len(os.sched_getaffinity(process_of(sweep / "0"))) == 1
        os.kill(process_of(sweep / "0"), signal.SIGKILL)  # as the kernel does when it is out of memory
        wait_for(lambda: not slurm(environment, "squeue", "--noheader").strip(), output)
        process.send_signal(signal.SIGINT)
    words = output.read_text()
    assert process.returncode == 128 + signal.SIGINT, words
    assert f"1 of {N_JOBS} jobs are not complete" in words
    assert f"{sweep / '0'}: killed" in words
    assert (sweep / "0" / "run.rrd.part").is_file()

    before = [read_summary(sweep / str(job))["started"] for job in range(N_JOBS)]
    done = subprocess.run([*command, f"sweep.resume={sweep}"], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0
    after = [read_summary(sweep / str(job)) for job in range(N_JOBS)]
    assert [each["started"] == started for each, started in zip(after, before, strict=True)] == [
        False,
        True,
        True,
        True,
    ]
    assert all(each["status"] == "complete" for each in after)


def wait_for(what, output):
    end = time.monotonic() + JOBS_PATIENCE_S
    while not what():
        assert time.monotonic() < end, output.read_text()
        time.sleep(0.1)


def process_of(folder: Path) -> int:
    """The process that works in a folder."""
    return int(re.search(r"process (\d+)", (folder / ".lock").read_text())[1])
