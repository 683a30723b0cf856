"""Quote `key=value` arguments for Hydra, whose grammar accepts only ASCII letters and few symbols."""

import os
import re

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from workbench.utils.errors import InputError

_FOLDERS = ("hydra.run.dir", "hydra.sweep.dir", "sweep.resume", "sweep.reuse", "paths.data", "paths.cache")
_GRAMMAR = re.compile(r"""[\[\]{}(),'"$\\]""")
"""Symbols of Hydra's grammar: a value with one of them may be a list or a sweep."""
_NAME = re.compile(r"(?<![\w.:/'\"-])\d+(?:_\d+)+(?![\w.:/'\"-])")
"""A clip name such as 35_02, which Hydra would parse as the number 3502."""


def quoted(argument: str) -> str:
    """Return an argument with its value quoted if Hydra cannot parse it, such as `n_track_losses>0` or a folder.

    A value with symbols of Hydra's grammar is unchanged, except for existing files, folders, clip names such as 35_02,
    and nested interpolations, which Hydra parses in quotes only. The name of an existing file is also quoted where
    Hydra would change it, such as 1e3 to 1000.0. Raises InputError where Hydra's parser fails, and as `literal`.
    """
    key, sign, value = argument.partition("=")
    if not sign or argument.startswith("-") or value[:1] in ("'", '"'):
        return argument
    if key not in _FOLDERS and os.path.exists(value) and (_GRAMMAR.search(value) or _is_changed(argument, value)):
        return f"{key}={literal(value)}"
    if "${" in value:
        return argument if "'" in value or _is_parsed(argument) else f"{key}='{value}'"
    value = _NAME.sub(r"'\g<0>'", value)
    argument = f"{key}={value}"
    if _is_parsed(argument) or (key not in _FOLDERS and _GRAMMAR.search(value)):
        return argument
    return f"{key}={literal(value)}"


def literal(value: str) -> str:
    """Return a value in quotes, which Hydra's grammar takes as it stands, with any symbols in it.

    Raises InputError for the name of a file with ${, which OmegaConf interpolates however it is quoted.
    """
    if "${" in value and os.path.exists(value):
        raise InputError(f"{value}: expected a name without ${{, which configurations interpolate; rename it")
    escaped = value.replace("'", r"\'").replace("${", r"\${")
    return f"'{escaped}'"


def _is_changed(argument: str, value: str) -> bool:
    """Return whether Hydra parses a value as another text, such as 1e3, 12.50, null or a blank in front."""
    return _is_parsed(argument) and str(OverridesParser.create().parse_override(argument).value()) != value


def _is_parsed(argument: str) -> bool:
    """Return whether Hydra parses a value, for a folder as a single value."""
    try:
        override = OverridesParser.create().parse_override(argument)
    except HydraException:
        return False
    except (ValueError, RecursionError) as error:  # thousands of digits, thousands of brackets
        name, _, value = argument.partition("=")
        raise InputError(f"{name}: expected a shorter value, found {len(value)} characters: {error}") from None
    return not (override.key_or_group in _FOLDERS and override.is_sweep_override())
