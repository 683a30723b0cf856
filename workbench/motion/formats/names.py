"""Names of clips: what they stand for, and who performed what they name."""

import re
from collections.abc import Iterable
from pathlib import Path

SUFFIXES = (".amc", ".bvh")
GENERATED = "builtin"
"""What the names of generated motions begin with: nobody's, and another person than any that is learned from."""
_MARKERS = (".trc", ".c3d")

BANDAI = {"dataset-1": "bandai-1", "dataset-2": "bandai-2"}
"""Who performed Bandai Namco's data sets, by the data set. Its documentation says that "each dataset is based on the
motion of three professional actors", whose proportions were made equal; of no clip does it say which of them it shows,
and the skeletons do not tell. So the three of a data set count as one person: whoever leaves out one leaves out all.
Whether the three of both data sets are the same people is not documented either."""


def clip_name(name: str) -> str:
    """The clip's name that a file's name, a LIBRARY.h5:clip or a CMU clip's number stands for.

    A command line may take 35_02 for the number 3502.
    """
    library, colon, clip = name.rpartition(":")
    if colon and library.endswith((".h5", ".hdf5")):
        return clip
    if name.lower().endswith(SUFFIXES):
        return Path(name).stem
    number = re.fullmatch(r"([0-9]+?)_?([0-9]{2})", name)
    return f"{number[1]}_{number[2]}" if number else name


def performer(name: str) -> str | None:
    """Tell who performed the clip of that name: "35" for CMU's 35_02, a data set of Bandai's, see BANDAI; None where
    the name does not say."""
    clip = clip_name(name)
    if cmu := re.fullmatch(r"(\d+)_\d+", clip):
        return cmu[1]
    return BANDAI.get(clip.partition("_")[0])


def style(name: str) -> str | None:
    """Tell in which style Bandai's clip of that name is performed: "bandai-old" for dataset-1_bow_old_001 and whatever
    else is so in either data set, whoever performs it; None for other clips."""
    bandai = re.fullmatch(r"(dataset-\d+)_[^_]+_([^_]+)_\d+", clip_name(name))
    return f"bandai-{bandai[2]}" if bandai else None


def left_out(names: Iterable[str], by_style: bool = False) -> list[str]:
    """Tell whom not to learn from in order to track what has these names: their performers, each once.

    by_style: of Bandai's clips their style, in all activities and both data sets, and not all of a data set. A clip
    whose name does not tell its performer stands for itself. Generated motions and markers are left aside.
    """
    clips = [name for name in names if not name.startswith(GENERATED) and not name.lower().endswith(_MARKERS)]
    who = [((style(name) if by_style else None) or performer(name) or clip_name(name)) for name in clips]
    return list(dict.fromkeys(who))
