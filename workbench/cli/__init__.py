"""The commands, each a thin layer over the rooms below."""

import sys
from types import TracebackType


def _interrupted(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Say in a sentence that a command was interrupted before it had begun; show anything else as Python does."""
    if issubclass(kind, KeyboardInterrupt):
        print("workbench: interrupted before anything was begun", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _interrupted  # here, as this is read before all that takes seconds to import
