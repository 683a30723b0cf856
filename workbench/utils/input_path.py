"""The type of parameters that name a file or a folder to read, and their home folder."""

from pathlib import Path
from typing import Annotated

InputPath = Annotated[str, "file or folder to read"]
"""A text that names a file or a folder. A recorded configuration may only name one below paths.data, or inputs next
to the recording."""


def expanded(path: str | Path) -> Path:
    """Return a path with the user's home folder for ~; unchanged where a file's name only begins so, as ~me.mp4."""
    try:
        return Path(path).expanduser()
    except RuntimeError:  # no user of this name
        return Path(path)
