"""Learned models on disk: HDF5 with provenance, written atomically."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import h5py
import numpy as np

from workbench import __version__
from workbench.errors import InputError
from workbench.files import whole_file
from workbench.learning.cycles import CHANNEL_NAMES, ROOT_CHANNELS
from workbench.learning.walking import WalkingModel

FORMAT = "workbench walking model 1"


@dataclass(frozen=True)
class Provenance:
    """Where a learned model comes from.

    sources: {name of the source file: its SHA-256}. parameters: those of the learning. licences: the sources' lines.
    code: a digest of the code that learned it.
    """

    sources: Mapping[str, str]
    parameters: Mapping[str, str | float | int | None]
    licences: tuple[str, ...]
    code: str = ""

    @property
    def key(self) -> str:
        """A SHA-256 over the inputs, the parameters and the learning's code: the same key means the same model."""
        text = json.dumps([FORMAT, self.code, dict(self.sources), dict(self.parameters)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def as_json(self) -> str:
        """Everything in one line, as the files keep it."""
        return json.dumps(asdict(self))


def write_model(path: Path, model: WalkingModel, provenance: Provenance) -> None:
    """Write the model to `path`; the file appears whole or not at all. Raises InputError when it cannot be written."""
    with whole_file(path, parents=True) as part, h5py.File(part, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["workbench"] = __version__
        file.attrs["provenance"] = provenance.as_json()
        file.attrs["channels"] = json.dumps((CHANNEL_NAMES + ROOT_CHANNELS)[: model.mean.shape[1]])
        for name in ("mean", "components", "scales"):
            file[name] = getattr(model, name)
        for name in ("cycle_rate_hz", "explained", "n_cycles"):
            file.attrs[name] = getattr(model, name)


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
    known = n_channels in (len(CHANNEL_NAMES), len(CHANNEL_NAMES + ROOT_CHANNELS))
    if model.mean.shape != (n_phases, n_channels) or model.scales.shape != (d,) or not known:
        raise InputError(f"{path}: expected a mean and components of one shape, found {model.mean.shape} and more")
    return model
