"""A recording in the Rerun viewer of a notebook, by the optional package rerun-notebook."""

import os
from pathlib import Path
from typing import Any

from workbench.utils.errors import InputError

_ASSET = "RERUN_NOTEBOOK_ASSET"


def notebook_viewer(path: Path) -> Any:
    """Return a widget with a recording in the viewer, which a notebook displays.

    The viewer's files come from the installed package, not from the network, unless RERUN_NOTEBOOK_ASSET says where
    from. Raises InputError if rerun-notebook is not installed or the recording cannot be read.
    """
    is_set = _ASSET in os.environ
    os.environ.setdefault(_ASSET, "serve-local")  # read at the first import, with version 0.41; there is no function
    try:
        from rerun_notebook import Viewer
    except ImportError:
        raise InputError(
            "show: requires rerun-notebook in the notebook's Python: pip install -e '.[notebook]'"
        ) from None
    finally:
        if not is_set:
            del os.environ[_ASSET]
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    viewer = Viewer(width="auto", height="auto")
    viewer.send_rrd(content)
    return viewer
