"""Files with markers, by what their names end in."""

from pathlib import Path

from workbench.errors import InputError
from workbench.mocap.c3d import read_c3d
from workbench.mocap.markers import Markers
from workbench.mocap.trc_reader import read_trc

READERS = {".trc": read_trc, ".c3d": read_c3d}


def read_markers(path: str | Path) -> Markers:
    """The markers of a .trc or .c3d file; raises InputError for what cannot be read."""
    path = Path(path).expanduser()
    if path.suffix.lower() not in READERS:
        raise InputError(f"{path}: expected a file of markers that ends in {' or '.join(READERS)}")
    return READERS[path.suffix.lower()](path)
