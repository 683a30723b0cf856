"""The frame of an .rrd file: a head of HEAD bytes, then messages of 16 bytes (kind, length) and their content.

The format is not documented; this was tested with rerun-sdk 0.41.
"""

import os
import struct
from typing import BinaryIO

HEAD = 12
_END = 0
"""Kind of the last message, the index of the others, which a file that was cut off does not have."""


def end_of_whole(file: BinaryIO, begin: int = HEAD) -> int:
    """Return the offset where the last whole message ends, the index left out.

    begin: offset of the first message to look at.
    """
    size, place = os.fstat(file.fileno()).st_size, begin
    while place + 16 <= size:
        file.seek(place)
        kind, length = struct.unpack("<QQ", file.read(16))
        if kind == _END or place + 16 + length > size:
            break
        place += 16 + length
    return place
