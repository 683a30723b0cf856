"""How an .rrd lies on the disk: HEAD bytes, then messages, each its kind and length, of 8 bytes, and its content."""

import os
import struct
from typing import BinaryIO

HEAD = 12
_END = 0
"""The kind of the last message, which says where the others are; what a run cut off left has none."""


def end_of_whole(file: BinaryIO, begin: int = HEAD) -> int:
    """Find where the last whole message ends, the very last left out, from `begin`, where one begins, on."""
    size, place = os.fstat(file.fileno()).st_size, begin
    while place + 16 <= size:
        file.seek(place)
        kind, length = struct.unpack("<QQ", file.read(16))
        if kind == _END or place + 16 + length > size:
            break
        place += 16 + length
    return place
