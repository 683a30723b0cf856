"""Storage of learned models: HDF5 with provenance, written atomically."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeGuard, TypeVar, get_args, get_origin, get_type_hints

import h5py
import numpy as np

from workbench import __version__
from workbench.motion.hdf5 import Hdf5, read_hdf5
from workbench.utils.atomic_write import optional_cache, whole_file
from workbench.utils.errors import InputError

FORMAT = "workbench model 3"


class _Model(Protocol):
    """A dataclass of arrays, numbers, tuples of numbers or strings, and another such model or None."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


Stored = TypeVar("Stored", bound=_Model)


@dataclass(frozen=True)
class Provenance:
    """Provenance of a learned model.

    sources : {name of the source file: its SHA-256}. parameters : of the training. licences : of the sources. code :
    digest of the training code.
    """

    sources: Mapping[str, str]
    parameters: Mapping[str, str | float | int | None]
    licences: tuple[str, ...]
    code: str = ""

    @property
    def key(self) -> str:
        """SHA-256 of the inputs, the parameters and the training code: equal keys mean equal models."""
        text = json.dumps([FORMAT, self.code, dict(self.sources), dict(self.parameters)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def as_stored(model: Stored) -> Stored:
    """Return a model with C-contiguous arrays, as they are when read from its file.

    Sums over other memory layouts may round differently, so that a run that learns the model would differ from a run
    that loads it.
    """
    contiguous: dict[str, Any] = {}
    for field in fields(model):
        value = getattr(model, field.name)
        if isinstance(value, np.ndarray):
            contiguous[field.name] = np.asarray(value, order="C")
        elif _is_model(value):
            contiguous[field.name] = as_stored(value)
    return replace(model, **contiguous)


def cache_model(path: Path, model: Stored, provenance: Provenance) -> Stored:
    """Write a model to a cache, if that is writable, and return it `as_stored`."""
    with optional_cache():
        save(path, model, provenance)
    return as_stored(model)


def save(path: Path, model: _Model, provenance: Provenance) -> None:
    """Write a model with its provenance, atomically. Arrays are data sets, all other fields are JSON.

    Raises InputError if the file cannot be written.
    """
    with whole_file(path, parents=True) as part, h5py.File(part, "w") as file:
        file.attrs.update(format=FORMAT, workbench=__version__, provenance=json.dumps(asdict(provenance)))
        _write(file, model)


def load(kind: type[Stored], path: Path) -> Stored:
    """Return a model from a file of `save`; raises InputError for any other file."""
    file = read_hdf5(path, f"a {kind.__name__}", own=True)
    try:
        return _read(kind, file, "")
    except (LookupError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: expected a {kind.__name__}: {error!r}; delete the file to learn the model again"
        ) from None


def _write(group: h5py.Group, model: _Model) -> None:
    for field in fields(model):
        value = getattr(model, field.name)
        if _is_model(value):
            _write(group.create_group(field.name), value)
        else:
            group[field.name] = value if isinstance(value, np.ndarray) else json.dumps(value)


def _read(kind: type[Stored], file: Hdf5, group: str) -> Stored:
    hints = get_type_hints(kind)
    return kind(**{field.name: _value(file, f"{group}/{field.name}", hints[field.name]) for field in fields(kind)})


def _value(file: Hdf5, place: str, hint: Any) -> Any:
    if place in file.attributes:
        kinds: list[type[_Model]] = [kind for kind in get_args(hint) if kind is not type(None)]
        return _read(kinds[0], file, place)
    if get_origin(hint) is np.ndarray:
        return file.arrays[place]
    value = json.loads(str(file.arrays[place]))
    return None if value is None else (get_origin(hint) or hint)(value)


def _is_model(value: Any) -> TypeGuard[_Model]:
    return is_dataclass(value)
