"""Sources of motions: names, files and folders, indices, and licences."""

import csv
import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from workbench.body.limbs import Body, person
from workbench.core.capabilities import component_traits, declares_traits
from workbench.core.side_information import LIMB_LENGTHS, LIMB_RADII
from workbench.motion.clip import MotionClip
from workbench.motion.formats.asf_amc import read_amc
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.formats.names import BANDAI, SUFFIXES, clip_name
from workbench.motion.formats.text import fail, read_lines
from workbench.motion.library import read_library
from workbench.motion.pose_sequence import Motion
from workbench.motion.retarget import retarget
from workbench.motion.synthetic.arm import bending_arm
from workbench.motion.synthetic.gait import subjects, walker
from workbench.motion.synthetic.run_gait import runner, runners
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_rate
from workbench.utils.input_path import InputPath, expanded
from workbench.utils.message_groups import grouped_messages

CMU_LICENCE = (
    "CMU Graphics Lab Motion Capture Database, mocap.cs.cmu.edu; created with funding from NSF EIA-0196217; "
    "free for all uses"
)
BANDAI_LICENCE = "Bandai Namco Research Motiondataset, CC BY-NC 4.0"
UNKNOWN = "unknown"
_BUILTIN_SECONDS = 60.0
_BUILTIN_SEED = 1999  # the walkers of "builtin" differ from those of `gait.builtin_motions`, as do their names


class _IndexRow(NamedTuple):
    """One row of the index of a copy of the CMU database."""

    clip: str
    subject: str
    activity: str
    rate_hz: float


def find_motion(name: str, *, data: str | None, rate_hz: float, path: str = "straight", seed: int = 0) -> Motion:
    """Return the motion `name`, resampled to `rate_hz`.

    Parameters
    ----------
    name : "builtin", a generated walker of 60 s on a "straight" or "circle" path, with a person per seed;
    "builtin_run",
        a generated runner; "builtin_arm", a generated arm; a CMU clip such as "35_02" or a Bandai clip such as
        "dataset-1_guide_normal_001" in the folder `data`; the path of an .amc or .bvh file; or "FILE.h5:clip", a clip
        of a motion library.
    data : folder of the recordings.
    rate_hz : Hz.
    path, seed : of a generated walker.

    Raises
    ------
    InputError : there is no such motion.
    """
    if name == "builtin":
        (subject,) = subjects(1, np.random.default_rng([_BUILTIN_SEED, seed]))
        return walker(replace(subject, name=f"walker_of_seed_{seed}"), _BUILTIN_SECONDS, rate_hz, path)
    if name == "builtin_run":
        (athlete,) = runners(1, np.random.default_rng([_BUILTIN_SEED, seed]))
        return runner(replace(athlete, name=f"runner_of_seed_{seed}"), _BUILTIN_SECONDS, rate_hz)
    if name == "builtin_arm":
        return bending_arm(_BUILTIN_SECONDS, rate_hz)
    library = name.rpartition(":")[0]
    if library.endswith((".h5", ".hdf5")):
        motions = {motion.name: motion for motion in read_library(library)}
        if (clip := clip_name(name)) not in motions:
            raise InputError(f"{library}: no motion {clip!r}, expected one of {', '.join(sorted(motions))}")
        return motions[clip].resampled(rate_hz)
    return load_motion(motion_file(name, data)).resampled(rate_hz)


def motion_file(name: str, data: str | None) -> Path:
    """Return the .amc or .bvh file of the motion `name`, see `find_motion`, by its path or below `data`.

    Raises InputError if there is no such file.
    """
    if name.lower().endswith(SUFFIXES):
        return expanded(name)
    if data is None:
        raise InputError(
            "dataset: motion must be builtin, builtin_run, builtin_arm, FILE.amc, FILE.bvh, LIBRARY.h5:clip or a "
            "recorded clip such as 35_02, which requires the folder with recordings (paths.data or $WORKBENCH_DATA); "
            f"found {name!r}"
        )
    try:
        return find_clip(data, name)
    except InputError as error:
        raise InputError(f"dataset: motion {name!r}: {error}") from None


def find_sources(paths: Iterable[str | Path]) -> list[Path]:
    """Return the motion files (.amc, .bvh) among `paths` and, sorted, in their folders and subfolders; each once.

    Raises InputError if a path does not exist, is a file of another kind, or a folder without motion files.
    """
    sources: dict[Path, Path] = {}
    for path in map(Path, paths):
        if path.is_dir():
            files = sorted(file for file in path.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file())
        else:
            files = [path] if path.is_file() and path.suffix.lower() in SUFFIXES else []
        if not files:
            problem = "a folder without any" if path.is_dir() else "another kind" if path.is_file() else "nothing"
            raise InputError(f"{path}: expected motion files ({', '.join(SUFFIXES)}), found {problem}")
        for file in files:
            sources.setdefault(file.resolve(), file)
    return list(sources.values())


@dataclass(frozen=True)
class Reading:
    """How motion files are read; None: by the file, its format's convention and the person's size and posture.

    unit : of length, one of `units.UNITS`. up : the file's vertical axis, x, y, z, -x, -y or -z. rate_hz : of an
    .amc file. asf : skeleton of .amc files. landmarks : the file's joints by the person's joints, e.g.
    {left_knee: LeftLeg}, where `joint_names` does not have them.
    """

    unit: str | None = None
    up: str | None = None
    rate_hz: float | None = None
    asf: str | Path | None = None
    landmarks: Mapping[str, str] | None = None


BY_FILE = Reading()


def read_clip(path: str | Path, reading: Reading = BY_FILE) -> MotionClip:
    """Return the skeleton and motion of one .amc file (with its .asf in the same folder) or .bvh file.

    The rate of an .amc is that of `reading`, else of the CMU index (index.csv in the file's folder or its parent), if
    any. Raises InputError if the file cannot be read or is of another kind.
    """
    path = Path(path)
    if path.suffix.lower() == ".amc":
        row = _index_row(path)
        rate_hz = row.rate_hz if reading.rate_hz is None and row else reading.rate_hz
        return read_amc(path, reading.asf, rate_hz, reading.unit, reading.up)
    if path.suffix.lower() == ".bvh":
        return read_bvh(path, reading.unit, reading.up, reading.landmarks)
    raise InputError(f"{path}: expected a motion file ({', '.join(SUFFIXES)})")


def load_motion(path: str | Path, reading: Reading = BY_FILE) -> Motion:
    """Return the retargeted motion of a clip, see `read_clip`.

    Subject and activity are those of the CMU index (index.csv in the file's folder or its parent), if any; else those
    of the file's name for CMU (subject only) and Bandai data; else "unknown", as is the licence. A Bandai subject is
    the data set ("bandai-1"), its activity the kind of motion; the style is in the name. `source` is the name of the
    file and its folder, never the whole path. Raises InputError if the file cannot be read or retargeted, or is of
    another kind.
    """
    path = Path(path)
    clip = read_clip(path, reading)
    bandai = re.fullmatch(r"(dataset-\d+)_([^_]+)_([^_]+)_\d+", path.stem)
    subject = activity = licence = UNKNOWN
    if path.suffix.lower() == ".amc":
        if row := _index_row(path):
            subject, activity, licence = row.subject, row.activity, CMU_LICENCE
        elif re.fullmatch(r"\d+_\d+", path.stem):
            subject, licence = path.stem.partition("_")[0], CMU_LICENCE
    elif bandai:
        subject, activity, licence = BANDAI.get(bandai[1], bandai[1]), bandai[2], BANDAI_LICENCE
    try:
        motion = retarget(clip, names=reading.landmarks)
    except InputError as error:  # add the file to the message
        raise InputError(f"{path}: {error}") from None
    source = "/".join(path.resolve().parts[-2:])
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return replace(motion, subject=subject, activity=activity, licence=licence, source=source, sha256=sha256)


@declares_traits(component_traits(assumptions=(LIMB_LENGTHS, LIMB_RADII)))
def body_of_file(
    *, file: InputPath, unit: str | None = None, up: str | None = None, landmarks: Mapping[str, str] | None = None,
    scale: float = 1.0,
) -> Body:  # fmt: skip
    """Return the person with the skeleton of a motion file, all lengths times `scale`; see `Reading`."""
    return person(load_motion(Path(file), Reading(unit=unit, up=up, landmarks=landmarks)).shape.scaled(scale))


def import_sources(
    paths: Iterable[str | Path], rate_hz: float | None = None, reading: Reading = BY_FILE
) -> tuple[list[Motion], list[str]]:
    """Return the motions of all files and folders in `paths`, and an error message for each unreadable one.

    rate_hz : rate to resample to; None: each file's rate. Raises InputError if the rate is not positive.
    """
    if rate_hz is not None:
        check_rate("import", rate_hz)
    motions, errors, files = [], [], []
    for path in paths:
        try:
            files += find_sources([path])
        except InputError as error:
            errors.append(str(error))
    with grouped_messages("workbench.motion"):
        for file in tqdm(find_sources(files), desc="import", unit="clip", disable=None):
            try:
                motion = load_motion(file, reading)
            except InputError as error:
                errors.append(str(error))
                continue
            motion = motion if rate_hz is None else motion.resampled(rate_hz)
            if len(motion) < 2:
                errors.append(f"{file}: expected a motion of two frames or more at {rate_hz or motion.rate_hz:g} Hz")
            else:
                motions.append(motion)
    return motions, errors


def find_clip(data: str | Path, name: str) -> Path:
    """Return the file below `data` of a CMU clip such as "35_02" or a Bandai clip "dataset-1_byebye_normal_001".

    Raises InputError if the name has neither form, or there is no such file.
    """
    name = clip_name(name)
    if cmu := re.fullmatch(r"(\d+)_\d+", name):
        file = expanded(data) / "cmu" / cmu[1] / f"{name}.amc"
    elif bandai := re.fullmatch(r"(dataset-\d+)_.+", name):
        file = expanded(data) / "bandai" / bandai[1] / f"{name}.bvh"
    else:
        raise InputError(f"expected a CMU clip such as 35_02 or a Bandai clip, found {name!r}")
    if not file.is_file():
        raise InputError(f"{file}: no such motion file")
    return file


def cmu_clips(data: str | Path, subjects: Sequence[str] | None) -> list[Path]:
    """Return the AMC files of walks of CMU subjects, e.g. ("02", "35"), or of all (None), in the order of the index.

    data : the folder with cmu/, which has index.csv and a folder per subject. Raises InputError if the index, a file or
    all of a subject's walks are missing.
    """
    folder = Path(data) / "cmu"
    rows = [row for row in _read_index(folder / "index.csv").values() if row.activity == "walk"]
    subjects = sorted({row.subject for row in rows}) if subjects is None else subjects
    if unknown := [subject for subject in subjects if subject not in {row.subject for row in rows}]:
        raise InputError(f"{folder / 'index.csv'}: expected clips of subject {unknown[0]!r} with activity 'walk'")
    clips = [folder / row.subject / f"{row.clip}.amc" for row in rows if row.subject in subjects]
    if missing := [clip for clip in clips if not clip.is_file()]:
        raise InputError(f"{missing[0]}: no such file, but the index lists it")
    return clips


def _index_row(path: Path) -> _IndexRow | None:
    """Return the file's row in the CMU index in the file's folder or its parent, or None."""
    for folder in path.resolve().parents[:2]:
        if (folder / "index.csv").is_file():
            return _read_index(folder / "index.csv").get(path.stem)
    return None


def _read_index(path: Path) -> dict[str, _IndexRow]:
    reader = csv.DictReader(read_lines(path))
    columns = _IndexRow._fields
    index = {}
    try:
        if not set(columns) <= set(reader.fieldnames or ()):
            fail(path, 1, f"expected the columns {', '.join(columns)} among others, found {reader.fieldnames}")
        for row in reader:
            rate_hz = check_rate(f"{path}, line {reader.line_num}", float(row["rate_hz"]))
            index[row["clip"]] = _IndexRow(row["clip"], row["subject"], row["activity"], rate_hz)
    except InputError:
        raise
    except (csv.Error, TypeError, ValueError) as error:
        fail(path, reader.line_num, f"expected a table of clips with a rate in Hz: {error}")
    return index
