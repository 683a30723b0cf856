"""Error messages of the command line; for an unknown option or key, with the existing and the most similar ones."""

import errno
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from workbench.utils.errors import InputError, RunFailure, shortened
from workbench.utils.process_limits import peak_bytes
from workbench.utils.signals import Interrupted

_BAD_INPUT = (InputError, HydraException, OmegaConfBaseException)
_OF_HYDRA = ("Expected header format: KEY VALUE", "Config group override must be a string or a list")
"""Hydra's ValueErrors for a header of another form in a file's first line, and for a number as an option."""
_NO_MEMORY = re.compile("allocate memory|failed to map segment|out of memory|std::bad_alloc", re.IGNORECASE)
_DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_OPTION = re.compile(r"Could not (?:find|load) '(\w+)/([^']*)'")
_KEY = re.compile(r"Key '([^']+)' not in '")
_PLACE = re.compile(r"full_key: (\S+)")
_FILE = re.compile(r"In '(\w+)/([^',]+)[^']*':(?: \w+ raised while composing config:)?")
_COMPONENT = re.compile(r"object_type=(\w+)_keys")
_MAX_LISTED = 40
_PLUGIN = re.compile(r"Could not (?:find|load) 'hydra/(launcher|sweeper)/([^']*)'")
_EXTRAS = {"joblib": "sweep", "submitit_local": "cluster", "submitit_slurm": "cluster", "optuna": "tune"}
"""The package's extra that installs each of Hydra's plug-ins."""


def report_error(error: BaseException) -> int | None:
    """Print an expected error and return the exit code; None for any other error.

    Expected errors are bad input (2), also a path that the system refuses (too long, without permission), a full disk,
    a lack of memory and a failed run (1), and an interruption by signal n (128 + n).
    """
    if isinstance(error, KeyboardInterrupt):
        number = error.number if isinstance(error, Interrupted) else signal.SIGINT
        _print_error([f"interrupted by {signal.Signals(number).name}; the recording so far is saved"])
        return 128 + number
    is_full = isinstance(error, OSError) and error.errno in _DISK_FULL
    is_path = isinstance(error, OSError) and error.filename is not None and not is_full
    is_bad = is_path or isinstance(error, _BAD_INPUT) or str(error).startswith(_OF_HYDRA)
    if (reason := _memory_reason(error)) is not None:
        _print_error([f"not enough memory: {reason}, and this process has had {peak_bytes() / 1e6:.0f} MB"])
        return 1
    if not (is_full or is_bad or isinstance(error, RunFailure)):
        return None
    _print_error(message_of(error))
    return 2 if is_bad else 1


def _memory_reason(error: BaseException) -> str | None:
    """Return what needed memory that the system did not give, if that is the error; libraries have errors of their
    own, and an extension that cannot be loaded is an ImportError."""
    text = " ".join(str(error).split())
    is_limit = isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM)
    if is_limit or (isinstance(error, (ImportError, RuntimeError, OSError)) and _NO_MEMORY.search(text)):
        return text or "an array or object did not fit"
    cause = error.__cause__ or error.__context__
    return None if cause is None or isinstance(error, _BAD_INPUT) else _memory_reason(cause)


def _print_error(message: Sequence[str]) -> None:
    """Print the lines of a message to stderr, the last one with the name of the command."""
    *listed, last = message
    print(*listed, f"workbench: {shortened(last)}", sep="\n", file=sys.stderr)


def message_of(error: BaseException) -> list[str]:
    """Return the lines of the message of an error and its causes, without Hydra's hints on debugging.

    For an unknown option or key the existing ones precede the message.
    """
    chain = list(_causes(error))
    texts: list[str] = []
    for cause in chain:
        text = " ".join(str(cause).split())
        if isinstance(cause, OSError) and cause.filename:
            text = f"{cause.filename}: {cause.strerror}"
        if text and not any(text in other for other in texts):
            texts.append(text)
    whole = ": ".join(texts)
    if (plugin := _PLUGIN.search(whole)) and plugin[2] in _EXTRAS:
        return [f"hydra/{plugin[1]}={plugin[2]} requires a plug-in of Hydra: pip install -e '.[{_EXTRAS[plugin[2]]}]'"]
    if place := _FILE.search(whole):
        file = _file(*place.groups())
        *listed, message = _explained(whole.replace(place[0], file), chain, place[2])
        return [*listed, message if message.startswith(file) else f"{file} {message}"]
    if "override_grammar" in whole:
        whole += "; put names with symbols in quotes: \"dataset.sources={left: 'walk (1).mp4', right: 'walk (2).mp4'}\""
    return _explained(whole, chain)


def _file(group: str, name: str) -> str:
    """Return the file of an option, followed by a colon."""
    from workbench.experiment.config.options import find, folders

    name = f"{'experiment' if group == 'if_chosen' else group}/{name}"
    return f"{find(folders().values(), f'{name}.yaml') or name}:"


def _explained(whole: str, chain: Sequence[BaseException], experiment: str = "") -> list[str]:
    """Return the message for an unknown option or key; any other text unchanged.

    experiment: the experiment whose file contains the option or key.
    """
    if option := _OPTION.search(whole):
        from workbench.experiment.config.options import options

        group, name = option.groups()
        return _unknown(f"{group}: there is no option {name!r}", name, sorted(options(group)), f"{group}=")
    if not (key := _KEY.search(whole)):
        return [whole]
    place, keys, component = _PLACE.search(whole), _keys(chain), _COMPONENT.search(whole)
    name = place[1] if place else key[1]
    group, before = name.partition(".")[0], name.rpartition(".")[0]
    if experiment and component and not get_close_matches(key[1], keys):
        return [
            f"the chosen {group} ({component[1]}) has no key {name}; "
            f"use experiment=custom with {group}=…, or the {group} of experiment={experiment}"
        ]
    return _unknown(f"there is no key {name}", key[1], keys, f"{before}." if before else "") if keys else [whole]


def _unknown(message: str, name: str, names: Sequence[str], before: str = "") -> list[str]:
    """Return the existing names, and the message with the most similar ones."""
    near = get_close_matches(name, names, n=3, cutoff=0.6)
    meant = f"; did you mean {' or '.join(before + similar for similar in near)}?" if near else ""
    more = [f"  and {len(names) - _MAX_LISTED} more"] if len(names) > _MAX_LISTED else []
    return ["available:", *(f"  {before}{existing}" for existing in names[:_MAX_LISTED]), *more, f"{message}{meant}"]


def _keys(chain: Sequence[BaseException]) -> list[str]:
    """Return the existing keys for an error on an unknown key."""
    for cause in chain:
        kind = getattr(cause, "object_type", None)
        if isinstance(kind, type) and is_dataclass(kind):
            return sorted(field.name for field in fields(kind) if not field.name.startswith("_"))
    return []


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
