"""What a command does where it is asked to end before it has begun, or after it is over: it says so, and nothing else.

Python would show where in its imports it was, or lose the signal there. Nothing is imported here that takes long.
"""

import os
import signal
import sys
from types import FrameType

_ASKING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PACKAGE = os.path.dirname(__file__)


def _end_plainly_until_begun() -> None:
    """Have the process, where it is one of the package's commands, end in a sentence while none of their `main` runs.

    Within `main` a signal does what it always does, until that has its own way.
    """
    if not _is_command():
        return
    for number in _ASKING:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _end)


def _is_command() -> bool:
    """Tell whether Python was started as `workbench…` or as `python -m workbench…`."""
    name = os.path.basename(sys.argv[0]) if getattr(sys, "argv", None) else ""
    if name == "-m":  # as long as the module is looked for
        name = next((text for text in sys.orig_argv[1:] if text.startswith("workbench")), "")
    return name.partition(".")[0].partition("-")[0] == "workbench"


def _end(number: int, frame: FrameType | None) -> None:
    if not _in_main(frame):
        os.write(2, f"workbench: interrupted by {signal.Signals(number).name}\n".encode())
        os._exit(128 + number)
    if number == signal.SIGINT:
        signal.default_int_handler(number, frame)
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


def _in_main(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_name == "main" and frame.f_code.co_filename.startswith(_PACKAGE):
            return True
        frame = frame.f_back
    return False


_end_plainly_until_begun()
