"""A command that is called in a process of its own, forked so that Python and what it imports need not start again."""

import os
import resource
import signal
import sys
import tempfile
import traceback
from dataclasses import dataclass
from pathlib import Path

_SLOWEST = 4
"""Times the seconds allowed, after which a process is ended."""


@dataclass(frozen=True)
class Ended:
    """How it ended. code: below 0 for a signal. told: what it printed. cpu_s, most_mb: what it took, of the processor
    and of memory, the latter beyond what the process had that it was forked from."""

    code: int
    told: str
    cpu_s: float
    most_mb: float


def call(main, arguments, longest_s, folder=None):
    """Call `main` with such a command line, within a folder; ends it by force where it takes much longer."""
    with tempfile.TemporaryFile() as out:
        if (child := os.fork()) == 0:
            os._exit(_child(main, arguments, longest_s, folder, out.fileno()))
        _, status, used = os.wait4(child, 0)
        out.seek(0)
        told = out.read().decode("utf-8", "replace")
    most = used.ru_maxrss - resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Ended(os.waitstatus_to_exitcode(status), told, used.ru_utime + used.ru_stime, max(0, most) / 1024)


def _child(main, arguments, longest_s, folder, out):
    code = 1
    try:
        os.dup2(out, 1)
        os.dup2(out, 2)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        most = int(_SLOWEST * longest_s)
        resource.setrlimit(resource.RLIMIT_CPU, (most, most + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.chdir(folder or Path.cwd())
        sys.argv = ["workbench", *arguments]
        code = main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001 (what the caller is to see)
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return code or 0
