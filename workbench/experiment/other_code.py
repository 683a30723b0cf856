"""Recordings run again by other code: that of another commit, in a worktree of its own, or another interpreter's."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from workbench.errors import InputError
from workbench.recording.read.reader import Run, read

ROOT = Path(__file__).parents[2]
"""The clone that this code is in, where it is in one."""


@contextmanager
def other_code(root: Path = ROOT) -> Iterator[Callable[[str], Path]]:
    """A worktree of the clone at `root`, gone afterwards; what it gives checks a commit out there and says where.

    One folder for all commits, so that what numba keeps of files that they share is found again. Raises InputError
    where there is no such commit.
    """
    with TemporaryDirectory(prefix="workbench-code-") as place:
        folder = Path(place) / "code"

        def check_out(commit: str) -> Path:
            if folder.is_dir():
                git(folder, "checkout", "--quiet", "--detach", resolved(commit, root))
            else:
                git(root, "worktree", "add", "--quiet", "--detach", str(folder), resolved(commit, root))
                (folder / "workbench" / "conf").symlink_to("../conf")  # a package of that name, as if installed
            return folder

        try:
            yield check_out
        finally:
            if folder.is_dir():
                git(root, "worktree", "remove", "--force", str(folder))


def resolved(commit: str, root: Path = ROOT) -> str:
    """The full name of a commit; raises InputError where there is none."""
    return git(root, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{commit}^{{commit}}").strip()


def commits_between(span: str, root: Path = ROOT) -> list[str]:
    """The commits after GOOD up to BAD, oldest first, of GOOD..BAD; merges count as one.

    Raises InputError where that is no span with BAD behind GOOD.
    """
    if not (match := re.fullmatch(r"([^\s.]\S*?)\.\.([^\s.]\S*)", span)):
        raise InputError(f"--bisect: expected GOOD..BAD, two commits, found {span!r}")
    good, bad = (resolved(commit, root) for commit in match.groups())
    found = git(root, "rev-list", "--reverse", "--first-parent", "--ancestry-path", f"{good}..{bad}").split()
    if not found:
        raise InputError(f"--bisect: {match[2]} does not lie behind {match[1]}")
    return [good, *found]


def subject(commit: str, root: Path = ROOT) -> str:
    """A commit's short name and the first line of its message."""
    return git(root, "log", "-1", "--format=%h %s", commit).strip()


def run_by(
    recordings: Sequence[Path], overrides: Sequence[str], folder: Path, code: Path | None = None, python: str = ""
) -> list[Run]:
    """Run the configurations of recordings again in another process: by the code in a folder, or an interpreter's own.

    Returns the new runs, which lie below `folder`. Raises InputError where one leaves none.
    """
    environment = dict(os.environ)
    if code is not None:
        environment["PYTHONPATH"] = str(code)
        environment["PYTHONDONTWRITEBYTECODE"] = "1"  # which is told from another commit's by second and size alone
        environment.setdefault("NUMBA_CACHE_DIR", str(folder.parent / "kernels"))
    names = [str(each.resolve()) for each in recordings]
    command = [python or sys.executable, "-P", "-m", "workbench.cli.check", *names, "--run", "--keep", str(folder)]
    try:
        done = subprocess.run([*command, *overrides], env=environment, capture_output=True, text=True, check=False)
    except OSError as error:
        raise InputError(f"{command[0]}: cannot be started: {error.strerror}") from None
    made = [folder / f"{k:03d}" / "run.rrd" for k in range(len(recordings))]
    if missing := [path for path in made if not path.is_file()]:
        words = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]
        raise InputError(f"{recordings[made.index(missing[0])]}: does not run by {code or python}: {' '.join(words)}")
    return [read(path) for path in made]


def git(root: Path, *arguments: str) -> str:
    """What git says; raises InputError where it refuses."""
    command = ["git", "-C", str(root), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise InputError(f"git: {error.strerror}") from None
    if done.returncode != 0:
        words = " ".join(done.stderr.split()) or f"no such commit: {arguments[-1]}"
        raise InputError(f"{root}: git {arguments[0]}: {words}")
    return done.stdout
