"""Comparison of this code with another commit's on this machine, by running recorded configurations."""

import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy  # noqa: F401 (loads the BLAS that is asked for its code path)
from threadpoolctl import threadpool_info

from workbench.recording.read.reader import Run, read
from workbench.results.check.agreement import Agreement, Demand
from workbench.results.check.compare import compare
from workbench.results.check.outcome import Check
from workbench.results.check.rerun import Request
from workbench.utils.errors import InputError
from workbench.utils.processes import CAPTURED, module, run
from workbench.utils.run_files import RECORDING

ROOT = Path(__file__).parents[3]
"""The clone of this code, where there is one."""


def check_against(runs: Sequence[Run], request: Request, revision: str, root: Path = ROOT) -> list[Check]:
    """Compare the runs of the recorded configurations by the code of a commit and by this code.

    Parameters
    ----------
    runs : their configurations are run; their recorded numbers are ignored.
    request : overrides, and the folder of the new runs.
    revision : of a commit for git, such as HEAD~1 or v0.2.
    root : the clone.

    Returns
    -------
    list of Check : one for each recording. Numbers must be equal to rounding, or identical if the request is exact.

    Raises
    ------
    InputError : the commit is unknown, there is no clone, or a recording does not run.
    """
    commit = git(root, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{revision}^{{commit}}").strip()
    name = git(root, "log", "-1", "--format=%h %s", commit).strip()
    demand = Demand(Agreement.IDENTICAL if request.exact else Agreement.ROUNDING, {})
    with _worktree(commit, root) as code:
        print(f"{len(runs)} recordings by {name}, then by this code", file=sys.stderr, flush=True)
        was = _run_by(runs, request, "was", code)
    now = _run_by(runs, request, "now", root)
    pairs = zip(runs, was, now, strict=True)
    return [Check(f"{run.path} against {commit[:8]}", compare(a, b, demand), was=a, now=b) for run, a, b in pairs]


@contextmanager
def _worktree(commit: str, root: Path) -> Iterator[Path]:
    """Yield a temporary folder with a commit checked out."""
    with TemporaryDirectory(prefix="workbench-") as place:
        folder = Path(place) / "code"
        git(root, "worktree", "add", "--quiet", "--detach", str(folder), commit)
        try:
            shutil.copytree(folder / "conf", folder / "workbench" / "conf")  # as in an installed package
            yield folder
        finally:
            git(root, "worktree", "remove", "--force", str(folder))


def _run_by(runs: Sequence[Run], request: Request, name: str, code: Path) -> list[Run]:
    """Run the configurations of recordings by the code in a folder, in a subprocess, and return the new runs.

    They are below `request.folder / name`. Raises InputError for a run without a recording.
    """
    folder = request.folder / name
    words = [*(str(run.path.resolve()) for run in runs), *request.overrides, "--run"]
    command = module("workbench", "check", *words, "-o", str(folder))
    environment = {**os.environ, "PYTHONPATH": str(code), "PYTHONDONTWRITEBYTECODE": "1"} | _blas_path()
    done = run(command, stdout=CAPTURED, env=environment)  # errors and progress are printed
    made = [folder / f"{k:03d}" / RECORDING for k in range(len(runs))]
    if missing := [k for k, path in enumerate(made) if not path.is_file()]:
        last = done.stdout.decode(errors="replace").strip().splitlines()[-1:]
        raise InputError(f"{runs[missing[0]].path}: does not run by the code in {code}: {' '.join(last)}")
    return [read(path) for path in made]


def _blas_path() -> dict[str, str]:
    """Return the variable that selects this process's code path of OpenBLAS for both commits."""
    paths = [each["architecture"] for each in threadpool_info() if "architecture" in each]
    return {"OPENBLAS_CORETYPE": paths[0]} if paths else {}


def git(root: Path, *arguments: str) -> str:
    """Return git's output; raises InputError on failure."""
    try:
        done = run(["git", "-C", str(root), *arguments], stdout=CAPTURED, stderr=CAPTURED)
    except OSError as error:
        raise InputError(f"git: {error.strerror}") from None
    if done.returncode != 0:
        words = " ".join(done.stderr.decode(errors="replace").split()) or f"no such commit: {arguments[-1]}"
        raise InputError(f"{root}: git {arguments[0]}: {words}")
    return done.stdout.decode(errors="replace")
