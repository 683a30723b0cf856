"""Recordings with flipped bits, and cut ones, through the commands: `python hostile_recordings.py recordings CASES SEED
[FOLDER]`.

It prints one line of JSON. Beside so many damaged recordings of all kinds lies a sound one, which every command shows.
"""

import contextlib
import io
import json
import logging
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np
from hostile import most_mb, spent_s
from hostile_hdf5 import flipped
from kinds_of_recordings import leave_kinds

from workbench.cli import check, export, report, runs, view
from workbench.errors import LONGEST
from workbench.recording.read import probe

TOGETHER = 100
"""Recordings in a folder."""

HANG_S = 5.0


def damaged(content, rng):
    """Flip bits and overwrite bytes, near the beginning and the end more often, or cut."""
    way = rng.random()
    if way < 0.2:
        return content[: int(rng.integers(0, len(content)))]
    if way < 0.4:  # the footer tells where everything is
        at = max(0, len(content) - int(rng.integers(1, 4000)))
        return content[:at] + flipped(content[at:], rng)
    if way < 0.7:
        data = bytearray(content)
        data[int(rng.integers(0, len(data)))] ^= 1 << int(rng.integers(0, 8))
        return bytes(data)
    return flipped(content, rng)


def called(told, words, main, *arguments):
    """Call a command: its exit code and what it printed; anything but 0, 1, 2 and sentences is counted."""
    out, error = io.StringIO(), io.StringIO()
    began = spent_s()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
            code = main([str(each) for each in arguments])
    except Exception as defect:  # noqa: BLE001 (what is counted)
        code = -1
        told["tracebacks"] += 1
        where = traceback.extract_tb(defect.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        told["first"].add(f"{words}: {type(defect).__name__}: {str(defect)[:80]} at {place}")
    spent = spent_s() - began
    told["hangs"] += spent > HANG_S + 0.3 * (len(arguments) + TOGETHER * words.startswith("many"))
    told["slowest_s"] = round(max(told["slowest_s"], spent), 3)
    lines = error.getvalue().splitlines()
    told["long"] += sum(len(line) > LONGEST + 60 for line in lines)
    told["codes"][f"{words} {code}"] = told["codes"].get(f"{words} {code}", 0) + 1
    return code, out.getvalue(), error.getvalue()


opened = []
"""What the viewer was asked to open."""


def together(told, folder, sound, kinds, n, rng):
    """Give a folder of damaged recordings beside a sound one to every command."""
    paths = []
    for k in range(n):
        path = folder / f"{k:03d}.rrd{'.part' if rng.random() < 0.2 else ''}"
        path.write_bytes(damaged(kinds[int(rng.integers(0, len(kinds)))], rng))
        paths.append(path)
    sound = folder / "sound.rrd"
    fatal = {whole: probe.fatal([*paths, sound], whole) for whole in (False, True)}
    told["fatal"] += len(fatal[True])
    if sound in fatal[True]:
        told["first"].add("the sound one is fatal")
    known = probe.fatal  # told once, not by every command again
    probe.fatal = lambda some, whole=False: fatal[whole] & set(some)
    try:
        for words, main, arguments in (
            ("many report", report.main, [folder]), ("many view", view.main, [folder]),
            ("many runs", runs.main, [folder, "--all"]),
        ):  # fmt: skip
            opened.clear()
            code, out, said = called(told, words, main, *arguments)
            shown = str(sound) in opened or f"{sound}: the same run as" in said  # as one whose damage nobody can see
            if words == "many view" and not shown:
                told["first"].add("many view: the sound one is not opened")
            if code != 0 or (str(sound) not in out and words == "many runs"):
                told["first"].add(f"{words}: the sound one is hidden: {code}")
        for path in paths:
            code, _, said = called(told, "export", export.main, path, folder / "out.csv")
            code, _, said = called(told, "check", check.main, path, sound)
            told["read" if code in (0, 1) and "expected" not in said else "refused"] += 1
            called(told, "view", view.main, path, sound)
    finally:
        probe.fatal = known
        for path in (*paths, folder / ".runs.json"):
            path.unlink(missing_ok=True)


def main(cases, seed, folder):
    """Damage so many recordings."""
    warnings.simplefilter("ignore")
    logging.disable()
    view.show = lambda command, files: opened.extend(map(str, files)) or 0
    check.prepare_hydra()
    own = check.own_defaults([])  # composed once, as it takes most of the time
    check.own_defaults, check.prepare_hydra = lambda _: own, lambda: None
    rng = np.random.default_rng(seed)
    leave_kinds(folder)
    kinds = [path.read_bytes() for path in sorted(folder.glob("*.rrd"))]
    for path in sorted(folder.glob("*.rrd")):
        path.unlink()
    (folder / "sound.rrd").write_bytes(kinds[0])
    told = {"cases": cases, "slowest_s": 0.0, "codes": {}, "first": set()}
    told |= dict.fromkeys(("read", "refused", "fatal", "long", "hangs", "tracebacks"), 0)
    for k in range(0, cases, TOGETHER):
        together(told, folder, folder / "sound.rrd", kinds, min(TOGETHER, cases - k), rng)
    print(json.dumps({**told, "most_mb": most_mb(), "first": sorted(told["first"])[:20]}), flush=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        main(int(sys.argv[2]), int(sys.argv[3]), Path(made if len(sys.argv) < 5 else sys.argv[4]))
