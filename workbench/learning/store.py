"""Learned models on disk: HDF5 with provenance, written atomically."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import NamedTemporaryFile

import h5py
import numpy as np

from workbench import __version__
from workbench.digest import code_digest
from workbench.errors import InputError
from workbench.learning import cycles, walking
from workbench.learning.cycles import CHANNEL_NAMES
from workbench.learning.walking import WalkingModel

FORMAT = "workbench walking model 1"


@dataclass(frozen=True)
class Provenance:
    """Where a learned model comes from.

    sources: {name of the source file: its SHA-256}. parameters: those of the learning. licences: the sources' lines.
    """

    sources: Mapping[str, str]
    parameters: Mapping[str, str | float | int | None]
    licences: tuple[str, ...]

    @property
    def key(self) -> str:
        """A SHA-256 over the inputs, the parameters and the learning's code: the same key means the same model."""
        code = code_digest(cycles, walking)
        text = json.dumps([FORMAT, code, dict(self.sources), dict(self.parameters)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def write_model(path: Path, model: WalkingModel, provenance: Provenance) -> None:
    """Write the model to `path`; the file appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with NamedTemporaryFile(dir=path.parent, prefix=path.name, suffix=".part", delete=False) as part:
        unfinished = Path(part.name)
    try:
        with h5py.File(unfinished, "w") as file:
            file.attrs["format"] = FORMAT
            file.attrs["workbench"] = __version__
            file.attrs["provenance"] = json.dumps(
                {
                    "sources": dict(provenance.sources),
                    "parameters": dict(provenance.parameters),
                    "licences": list(provenance.licences),
                }
            )
            file.attrs["channels"] = json.dumps(CHANNEL_NAMES)
            for name in ("mean", "components", "scales"):
                file[name] = getattr(model, name)
            for name in ("cycle_rate_hz", "explained", "n_cycles"):
                file.attrs[name] = getattr(model, name)
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def read_model(path: Path) -> WalkingModel:
    """Read a model; raises InputError when the file is missing or is not a walking model of this format."""
    if not path.is_file():
        raise InputError(f"{path}: no such model file")
    try:
        with h5py.File(path, "r") as file:
            found = file.attrs.get("format")
            if found != FORMAT:
                raise InputError(f"{path}: expected a file of format {FORMAT!r}, found {found!r}")
            rate = np.asarray(file.attrs["cycle_rate_hz"], dtype=np.float64)
            model = WalkingModel(
                mean=file["mean"][:],
                components=file["components"][:],
                scales=file["scales"][:],
                cycle_rate_hz=(float(rate[0]), float(rate[1])),
                explained=float(file.attrs["explained"]),
                n_cycles=int(file.attrs["n_cycles"]),
            )
    except (OSError, KeyError) as error:
        raise InputError(f"{path}: expected a walking model in HDF5: {error}") from None
    d, n_phases, n_channels = model.components.shape
    if model.mean.shape != (n_phases, n_channels) or model.scales.shape != (d,) or n_channels != len(CHANNEL_NAMES):
        raise InputError(f"{path}: expected a mean and components of one shape, found {model.mean.shape} and more")
    return model
