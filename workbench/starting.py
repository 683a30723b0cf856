"""What a command does where it is asked to end before it has begun, or after it is over: it says so, and nothing else.

Python would show where in its imports it was, or lose the signal there. Nothing is imported here that takes long.

And how often Python looks for garbage before a run's first frame: after every 700 new objects, which takes a sixth of
the time until then, and nearly all of them stay to the end.
"""

import gc
import os
import signal
import sys
from types import FrameType

_ASKING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PACKAGE = os.path.dirname(__file__)
_USUAL, _RARELY = gc.get_threshold(), 200_000


def _end_plainly_until_begun() -> None:
    """Have the process, where it is one of the package's commands, end in a sentence while none of their `main` runs.

    Within `main` a signal does what it always does, until that has its own way.
    """
    if not _is_command():
        return
    for number in _ASKING:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _end)


def _collect_rarely_until_begun() -> None:
    """Have `workbench`, not the other commands, look for garbage rarely until `collect_as_usual`."""
    if _command() == "workbench":
        gc.set_threshold(_RARELY, *_USUAL[1:])


def collect_as_usual() -> None:
    """Have Python look for garbage as often as it does by itself; to be called before frames come and go."""
    if gc.get_threshold() != _USUAL:
        gc.freeze()  # what there is stays, and is not looked through time and again
        gc.set_threshold(*_USUAL)


def _is_command() -> bool:
    """Tell whether Python was started as `workbench…` or as `python -m workbench…`."""
    return _command().partition(".")[0].partition("-")[0] == "workbench"


def _command() -> str:
    """Return what Python was started as: the name of a command, or of the module after `-m`."""
    name = os.path.basename(sys.argv[0]) if getattr(sys, "argv", None) else ""
    if name == "-m":  # as long as the module is looked for
        name = next((text for text in sys.orig_argv[1:] if text.startswith("workbench")), "")
    return name


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
_collect_rarely_until_begun()
