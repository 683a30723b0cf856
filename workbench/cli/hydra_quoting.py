"""Arguments key=value as Hydra takes them, whose grammar knows no letters but English ones, and few signs."""

import re

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from workbench.utils.errors import InputError

_FOLDERS = ("hydra.run.dir", "hydra.sweep.dir", "sweep.resume", "sweep.reuse", "paths.data", "paths.cache")
_MEANT = re.compile(r"""[\[\]{}(),'"$\\]""")
"""What means something in Hydra's grammar, so that whoever writes it has to say what."""


def quoted(argument: str) -> str:
    """Put a value that Hydra cannot read, such as `times_lost>0` or the name of a folder, into quotes.

    Of a key that is no folder's, one with brackets, commas, quotes or the like stays as it is, as it may be meant as a
    list or a sweep. Raises InputError for what no grammar gets to the end of.
    """
    key, sign, value = argument.partition("=")
    if not sign or argument.startswith("-") or value[:1] in ("'", '"') or "${" in value:
        return argument
    if _is_read(argument) or (key not in _FOLDERS and _MEANT.search(value)):
        return argument
    return f"{key}='{value.replace(chr(39), chr(92) + chr(39))}'"


def unquoted(value: str) -> str:
    """Take the quotes from around a value that somebody has put into them."""
    return value[1:-1] if len(value) > 1 and value[0] == value[-1] in ("'", '"') else value


def _is_read(argument: str) -> bool:
    """Tell whether Hydra reads a value, and one only where it is a folder's."""
    try:
        override = OverridesParser.create().parse_override(argument)
    except HydraException:
        return False
    except (ValueError, RecursionError) as error:  # thousands of digits, thousands of brackets
        name, _, value = argument.partition("=")
        raise InputError(f"{name}: expected a value, found one of {len(value)} characters: {error}") from None
    return not (override.key_or_group in _FOLDERS and override.is_sweep_override())
