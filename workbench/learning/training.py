"""From the name of a training set to a learned walking model, through a cache."""

import hashlib
import logging
from collections.abc import Sequence
from pathlib import Path

from workbench.datasets.gait import builtin_motions
from workbench.digest import code_digest
from workbench.errors import InputError
from workbench.learning.store import Provenance, read_model, write_model
from workbench.learning.walking import WalkingModel, learn_walking
from workbench.mocap import asf_amc, clip, retarget
from workbench.mocap.library import read_library, write_library
from workbench.mocap.motion import Motion
from workbench.mocap.sources import cmu_clips, import_sources

log = logging.getLogger(__name__)


def walking_model(
    motions: str,
    *,
    data: str | None,
    cache: str,
    subjects: Sequence[str],
    variance: float,
    n_components: int | None,
    scaling: str,
) -> WalkingModel:
    """The model learned from `motions`: "builtin", "cmu" (walking clips of `subjects` under `data`) or a library file.

    A model with the same sources and parameters is taken from the folder `cache` instead of being learned again.
    Raises InputError when the motions cannot be read or hold too few walking cycles.
    """
    training = training_motions(motions, data=data, cache=cache, subjects=subjects)
    provenance = Provenance(
        sources={f"{motion.source}#{motion.name}": motion.sha256 for motion in training},
        parameters={"variance": variance, "n_components": n_components, "scaling": scaling},
        licences=tuple(sorted({motion.licence for motion in training})),
    )
    path = Path(cache).expanduser() / "models" / f"walking-{provenance.key[:16]}.h5"
    if path.is_file():
        return read_model(path)
    model = learn_walking(training, variance=variance, n_components=n_components, scaling=scaling)
    write_model(path, model, provenance)
    return model


def training_motions(motions: str, *, data: str | None, cache: str, subjects: Sequence[str]) -> tuple[Motion, ...]:
    """The motions a training set's name stands for; see `walking_model`."""
    if motions == "builtin":
        return builtin_motions()
    if motions == "cmu":
        if data is None:
            raise InputError(
                "prior.motions=cmu needs the folder with the recordings: set paths.data or $WORKBENCH_DATA"
            )
        return _cmu_walks(Path(data), Path(cache).expanduser(), subjects)
    if motions.endswith((".h5", ".hdf5")):
        return read_library(Path(motions))
    raise InputError(f"prior.motions must be builtin, cmu or a motion library FILE.h5, found {motions!r}")


def _cmu_walks(data: Path, cache: Path, subjects: Sequence[str]) -> tuple[Motion, ...]:
    clips = cmu_clips(data, subjects)
    library = cache / "motions" / f"cmu-{_digest(clips)[:16]}.h5"
    if not library.is_file():
        motions, bad = import_sources(clips)
        for sentence in bad:
            log.warning("left out of the training set: %s", sentence)
        library.parent.mkdir(parents=True, exist_ok=True)
        write_library(library, motions)
    return read_library(library)


def _digest(paths: Sequence[Path]) -> str:
    digest = hashlib.sha256(code_digest(asf_amc, clip, retarget).encode())
    skeletons = {skeleton for path in paths for skeleton in path.parent.glob("*.asf")}
    for path in sorted({*paths, *skeletons}):
        digest.update(f"{path.name}:".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
