"""Find the recordings whose bytes are damaged so that Rerun's decoder does not survive reading them."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.recording.read.reader import Run, read


def fatal(paths: Sequence[Path]) -> set[Path]:
    """Find those of the recordings that end whoever reads them, by an error that is no InputError or without any.

    A flipped bit can make the decoder ask for more memory than there is, on which it aborts without raising; so
    another process goes first, and a new one goes on behind every file that one does not survive.
    """
    found: set[Path] = set()
    left = list(paths)
    while left:
        command = [sys.executable, "-m", "workbench.recording.read.probe", *map(str, left)]
        told = subprocess.run(command, capture_output=True, text=True, check=False).stdout.split()
        found |= {path for path, word in zip(left, told, strict=False) if word == "damaged"}
        found |= set(left[len(told) : len(told) + 1])
        left = left[len(told) + 1 :]
    return found


def read_all(path: Path) -> Run:
    """Read a recording with everything that `Run` knows of it; raises InputError as that does."""
    run = read(path)
    if not run.is_study:
        _ = run.poses
    _ = run.settings, run.joints, run.true_joints, run.scalars, run.marginals, run.figures, run.note
    return run


def main(paths: Sequence[str]) -> None:
    """Read the recordings one by one and print after each whether reading it again is safe."""
    for path in paths:
        outcome = "read"
        try:
            read_all(Path(path))
        except InputError:
            pass  # whoever reads it next is told what is wrong with it
        except Exception:  # noqa: BLE001 (damaged values lead anywhere)
            outcome = "damaged"
        print(outcome, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
