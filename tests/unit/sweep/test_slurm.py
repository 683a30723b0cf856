"""What becomes of jobs on clusters with accounting and without."""

import os
import subprocess
import time
from types import SimpleNamespace

import pytest
from hydra.core.utils import JobReturn, JobStatus

from workbench.sweep import slurm
from workbench.sweep.slurm import HEADER, let_slurm_end, states_of

TOLD = """\
JobId=8 ArrayJobId=7 ArrayTaskId=0 JobName=a b JobState=OUT_OF_MEMORY Reason=None NodeList=node3 Command=x=y
JobId=7 ArrayJobId=7 ArrayTaskId=2-5%2 ArrayTaskThrottle=2 JobState=PENDING Reason=Resources NodeList= Power=

"""


@pytest.fixture
def controller(monkeypatch):
    """Have scontrol know array 7, have forgotten 6, and not answer about 5; there is no sacct."""

    def run(command, **_):
        if command[0] == "sacct":
            raise FileNotFoundError(command[0])
        told = {"7": (TOLD, "", 0), "6": ("", "slurm_load_jobs error: Invalid job id specified\n", 1)}
        out, error, code = told.get(command[-1], ("", "Unable to contact slurm controller", 1))
        return subprocess.CompletedProcess(command, code, out, error)

    monkeypatch.setattr(slurm, "subprocess", SimpleNamespace(run=run))


def test_states_are_told_as_accounts_tell_them(controller):
    assert states_of(["6", "7"]).splitlines() == [HEADER, "6|GONE|", "7_0|OUT_OF_MEMORY|node3", "7_[2-5%2]|PENDING|"]
    with pytest.raises(subprocess.CalledProcessError):
        states_of(["5"])


def test_submitit_understands_them(controller):
    pytest.importorskip("submitit")
    watcher = slurm._watcher()
    for job in ("7_0", "7_3", "6_1", "5_0"):
        watcher.register_job(job)
    watcher._last_status_check = 0.0
    done = {job: watcher.is_done(job) for job in ("7_0", "7_3", "6_1", "5_0")}
    assert done == {"7_0": False, "7_3": False, "6_1": False, "5_0": False}  # as one does not answer
    watcher = slurm._watcher()
    for job in ("7_0", "7_3", "6_1"):
        watcher.register_job(job)
    assert {job: watcher.is_done(job) for job in ("7_0", "7_3", "6_1")} == {"7_0": True, "7_3": False, "6_1": True}
    assert watcher.get_state("6_1") == "GONE"


def test_a_job_without_a_result_is_the_worst_and_a_defect_is_none(capsys):
    utils = pytest.importorskip("submitit.core.utils")
    job = SimpleNamespace(job_id="7_0", state="OUT_OF_MEMORY")

    def ended(error):
        def results(_):
            raise error

        return slurm._patient(results, float("inf"))(job)

    (given,) = ended(utils.UncompletedJobError("has not produced any output"))
    assert given.return_value == float("inf")
    assert "Slurm's job 7_0 left no result, its state is OUT_OF_MEMORY" in capsys.readouterr().err
    with pytest.raises(utils.FailedJobError, match="by a defect"):
        ended(utils.FailedJobError("by a defect"))


def test_a_job_whose_time_is_up_is_the_worst_and_one_that_came_to_a_number_is_not():
    utils = pytest.importorskip("submitit.core.utils")
    late = JobReturn(status=JobStatus.FAILED, _return_value=utils.UncompletedJobError("timed-out too many times"))
    good = JobReturn(status=JobStatus.COMPLETED, _return_value=3.0)
    given = [slurm._patient(lambda _, each=each: [each], float("inf"))(None)[0].return_value for each in (late, good)]
    assert given == [float("inf"), 3.0]


ACCOUNTS = """\
JobID|State|NodeList
7_0|COMPLETED|node1
7_0.batch|COMPLETED|node1
7_0.extern|COMPLETED|node1
7_1|TIMEOUT|node1
7_1.batch|CANCELLED|node1
7_2|CANCELLED by 1000|node2
7_3|OUT_OF_MEMORY|node1
7_3.batch|OUT_OF_MEMORY|node1
7_4|NODE_FAIL|node3
7_5|FAILED|node[1-2]
7_6|RUNNING|node1
7_[7-9%2]|PENDING|None assigned
"""
ENDS = ("COMPLETED", "TIMEOUT", "CANCELLED by 1000", "OUT_OF_MEMORY", "NODE_FAIL", "FAILED")


@pytest.fixture
def accounts(tmp_path, monkeypatch):
    """A `sacct` that prints what Slurm 22.05 does, until it is told to fail, and a `scontrol` that knows of job 7_6."""
    jobs = pytest.importorskip("submitit.slurm.slurm").SlurmJob
    monkeypatch.setattr(jobs, "_results_timeout_s", 0)
    for name in ("results", "watcher"):  # which are replaced for good
        monkeypatch.setattr(jobs, name, getattr(jobs, name))
    (tmp_path / "accounts").write_text(ACCOUNTS)
    fails = 'echo "sacct: error: Problem talking to the database: Connection refused" >&2; exit 1'
    record = "JobId=14 ArrayJobId=7 ArrayTaskId=6 JobState=OUT_OF_MEMORY NodeList=node1"
    asked = 'echo "$@" > asked; [ "$1 $2 $3" = "--format=JobID,State,NodeList --parsable2 --jobs=7" ] || exit 1'
    commands = {"sacct": f"cd {tmp_path}\n{asked}\n[ -e down ] && {{ {fails}; }}\ncat accounts",
                "scontrol": f"echo {record}"}  # fmt: skip
    for name, lines in commands.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{lines}\n")
        (tmp_path / name).chmod(0o700)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    let_slurm_end(float("inf"))
    return jobs, tmp_path


def test_what_accounts_tell_of_jobs_that_left_no_result_is_said(accounts, capsys):
    jobs, folder = accounts
    all_jobs = [jobs(folder, f"7_{k}") for k in range(10)]
    assert [job.done(force_check=True) for job in all_jobs] == [True] * 6 + [False] * 4
    for k, state in enumerate(ENDS):
        (given,) = all_jobs[k].results()
        assert given.return_value == float("inf")
        assert f"Slurm's job 7_{k} left no result, its state is {state}\n" in capsys.readouterr().err


def test_while_accounts_are_not_told_the_controller_is_asked(accounts, capsys):
    jobs, folder = accounts
    job = jobs(folder, "7_6")
    assert not job.done(force_check=True)
    (folder / "down").touch()
    time.sleep(0.01)  # submitit does not ask twice in a millisecond
    assert job.done(force_check=True)
    assert (folder / "asked").read_text().split() == ["--format=JobID,State,NodeList", "--parsable2", "--jobs=7"]
    (given,) = job.results()
    assert given.return_value == float("inf")
    assert "7_6 left no result, its state is OUT_OF_MEMORY" in capsys.readouterr().err
