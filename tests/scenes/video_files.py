"""Video files with chosen frame times."""

import struct

import cv2
import numpy as np


def video(path, n, rate_hz, size=(160, 120)):
    """Write an MP4 file of n frames at a constant rate; frame k has grey level 4 k."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, size)
    for k in range(n):
        writer.write(np.full((size[1], size[0], 3), 4 * k % 256, np.uint8))
    writer.release()
    return path


def camera_table(name, size, focal_px, x_m=0.0):
    """Return the TOML table of a level camera without distortion, 4 m behind the origin."""
    u, v = (0.5 * (side - 1) for side in size)
    return (
        f"[{name}]\nsize = {list(size)}\nmatrix = [[{focal_px}, 0.0, {u}], [0.0, {focal_px}, {v}], [0.0, 0.0, 1.0]]\n"
        f"distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [1.57, 0.0, 0.0]\ntranslation = [{x_m}, 1.0, 4.0]\n"
    )


def with_durations(path, durations):
    """Set the durations of an MP4 file's frames, in multiples of the constant one, in its time table (stts)."""
    content = bytearray(path.read_bytes())
    place = content.index(b"stts") - 4
    size, _, _, entries, count, delta = struct.unpack(">I4sIIII", content[place : place + 24])
    assert (entries, count, size) == (1, len(durations), 24)
    table = b"".join(struct.pack(">II", 1, round(delta * duration)) for duration in durations)
    new = struct.pack(">I4sII", 16 + len(table), b"stts", 0, len(durations)) + table
    for name in (b"stbl", b"minf", b"mdia", b"trak", b"moov"):  # the boxes that contain it, after the images
        outer = content.rindex(name, 0, place) - 4
        (before,) = struct.unpack(">I", content[outer : outer + 4])
        content[outer : outer + 4] = struct.pack(">I", before + len(new) - 24)
    content[place : place + 24] = new
    path.write_bytes(content.replace(b"edts", b"free"))  # an edit list would end the video too early
    return path
