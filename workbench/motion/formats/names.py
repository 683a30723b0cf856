"""Names of clips: the clips and performers that they denote."""

import re
from collections.abc import Iterable
from pathlib import Path

SUFFIXES = (".amc", ".bvh")
GENERATED = "builtin"
"""Prefix of the names of generated motions, whose subjects are not in any training set."""
_MARKERS = (".trc", ".c3d")

BANDAI = {"dataset-1": "bandai-1", "dataset-2": "bandai-2"}
"""Performers of Bandai Namco's data sets. By the documentation "each dataset is based on the motion of three
professional actors", whose proportions were made equal; neither it nor the skeletons identify a clip's actor. So the
three of a data set count as one person."""


def clip_name(name: str) -> str:
    """Return the clip's name from a file's name, a LIBRARY.h5:clip or a CMU clip's number (3502: 35_02)."""
    library, colon, clip = name.rpartition(":")
    if colon and library.endswith((".h5", ".hdf5")):
        return clip
    if name.lower().endswith(SUFFIXES):
        return Path(name).stem
    number = re.fullmatch(r"([0-9]+?)_?([0-9]{2})", name)
    return f"{number[1]}_{number[2]}" if number else name


def performer(name: str) -> str | None:
    """Return the performer of a clip: "35" for CMU's 35_02, for Bandai's see BANDAI; None if unknown."""
    clip = clip_name(name)
    if cmu := re.fullmatch(r"(\d+)_\d+", clip):
        return cmu[1]
    return BANDAI.get(clip.partition("_")[0])


def style(name: str) -> str | None:
    """Return the style of a Bandai clip, "bandai-old" for dataset-1_bow_old_001; None for other clips."""
    bandai = re.fullmatch(r"(dataset-\d+)_[^_]+_([^_]+)_\d+", clip_name(name))
    return f"bandai-{bandai[2]}" if bandai else None


def excluded_subjects(names: Iterable[str]) -> list[str]:
    """Return the performers of clips, each once, to be excluded from the training set of a model that tracks them.

    A clip without a known performer is returned itself. Generated motions and markers have none.
    """
    clips = [name for name in names if not name.startswith(GENERATED) and not name.lower().endswith(_MARKERS)]
    return list(dict.fromkeys(performer(name) or clip_name(name) for name in clips))
