"""Runs that a signal ends at random times, and what is left of them: `python kills.py CASES SEED FOLDER`.

It prints one line of JSON. Every fifth run finds an empty cache. Whatever is left is read when all are over.
"""

import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.recording.read.reader import read
from workbench.utils.errors import InputError

N_FRAMES = 60
SMALL = ("inference.n_particles=6000", "dataset.width=160", "dataset.height=120", "dataset.person_px=80")
SMALL += ("dataset.focal_px=175", f"dataset.n_frames={N_FRAMES}")
WAYS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
LONGEST_S = 300.0
MOST_LOST = 2
"""Frames that were told and are not on the disk."""

_TOLD = re.compile(rf"(\d+)/{N_FRAMES} \[")


@dataclass(frozen=True)
class Case:
    """A run. way: the signal it gets after so many seconds; None: it is left alone."""

    folder: Path
    cache: Path
    way: signal.Signals | None = None
    after_s: float = LONGEST_S


@dataclass(frozen=True)
class Left:
    """What became of a run: exit code, what a terminal showed, how long it took; hung: it had to be killed."""

    code: int
    told: str
    took_s: float
    hung: bool

    @property
    def n_told(self):
        """Frames that the progress bar said were done."""
        shown = "".join(line for line in self.told.splitlines() if "rendering" not in line)
        return max(map(int, _TOLD.findall(shown)), default=0)


def begin(case):
    """Start a run at a terminal of its own: its process, and what reads the terminal."""
    child, terminal = pty.fork()
    if child:
        return child, terminal
    fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 200, 0, 0))  # in one of no width no bar is drawn
    os.environ |= {"WORKBENCH_CACHE": str(case.cache), "NUMBA_NUM_THREADS": "1"}
    os.environ.pop("WORKBENCH_DATA", None)
    words = [*SMALL, f"hydra.run.dir={case.folder}"]
    os.execv(sys.executable, [sys.executable, "-m", "workbench", "run", *words])


def let_run(case):
    """Run a case to its end."""
    began, told, left = time.monotonic(), b"", [case.way]
    child, terminal = begin(case)
    while True:
        passed = time.monotonic() - began
        if left and left[0] is not None and passed >= case.after_s:
            os.kill(child, left.pop())
        until = case.after_s if left else LONGEST_S
        ready, _, _ = select.select([terminal], [], [], max(0.0, until - passed))
        more = b""
        with suppress(OSError):  # as when its other end is closed
            more = os.read(terminal, 65536) if ready else b""
        told += more
        if (ready and not more) or passed > LONGEST_S:
            break
    if hung := passed > LONGEST_S:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    return Left(os.waitstatus_to_exitcode(status), told.decode("utf-8", "replace"), passed, hung)


def flaws(case, left):
    """What is wrong with what a run left, and how many frames of those told are lost."""
    found, n_kept = [], 0
    published, part, summary = (case.folder / name for name in ("run.rrd", "run.rrd.part", "summary.json"))
    recording = published if published.is_file() else part
    if recording.is_file():
        try:
            run = read(recording)
            n_kept = len(run.poses[0])
            if published.is_file() and (run.status, n_kept) != ("complete", N_FRAMES):
                found.append(f"published, but {run.status} with {n_kept} frames")
        except InputError as error:
            if left.n_told > MOST_LOST:
                found.append(f"unreadable: {error}")
    status = json.loads(summary.read_text())["status"] if summary.is_file() else None
    killed = case.way == signal.SIGKILL
    if published.is_file():
        sound = status == "complete" or (killed and status == "running")
    else:
        sound = status in ((None, "running") if killed else (None, "interrupted"))
    if not sound:
        found.append(f"{case.way.name}: summary says {status}, published: {published.is_file()}")
    ends = {-signal.SIGKILL, 0} if killed else {128 + case.way, 0}
    by_itself = status is None or published.is_file()  # before Python hears of signals, and when all is over
    if left.code not in ends and not (by_itself and left.code == -case.way):
        found.append(f"{case.way.name}: ended with {left.code}")
    if left.code == 0 and not published.is_file():
        found.append(f"{case.way.name}: ended with 0, nothing is published")
    if "Traceback" in left.told and not by_itself:
        found.append(f"{case.way.name}: a traceback: {left.told.splitlines()[-1][:200]}")
    if left.hung:
        found.append(f"{case.way.name}: hung")
    return found, max(0, left.n_told - n_kept)


def main(n_cases, seed, root):
    """End so many runs, all ways in turn."""
    rng, warm = np.random.default_rng(seed), root / "cache"
    quiet = let_run(Case(root / "quiet", warm))  # which compiles
    assert quiet.code == 0, quiet
    longest = let_run(Case(root / "quieter", warm)).took_s
    cases = [
        Case(root / str(k), root / f"cache {k}" if k % 5 == 4 else warm, WAYS[k % 4], rng.uniform(0.0, longest))
        for k in range(n_cases)
    ]
    left = [let_run(case) for case in cases]
    last = Case(root / "last", warm)
    assert let_run(last).code == 0
    counts, found, lost = Counter(), [], []
    for case, each in zip(cases, left, strict=True):
        wrong, n_lost = flaws(case, each)
        found += wrong
        lost.append(n_lost)
        at = "began" if not (case.folder / "summary.json").is_file() else "ran" if each.code else "over"
        counts[f"{case.way.name} {at}"] += 1
    same = np.array_equal(read(root / "last" / "run.rrd").poses[1], read(root / "quiet" / "run.rrd").poses[1])
    told = {"cases": n_cases, "flaws": len(found), "most_lost": max(lost), "lost": sum(n > 0 for n in lost)}
    told |= {"told": sum(each.n_told > 0 for each in left), "next_is_equal": same, "longest_s": longest}
    print(json.dumps({**told, "when": dict(sorted(counts.items())), "first": found[:20]}), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
