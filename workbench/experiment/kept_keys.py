"""The keys of the workbench's own parts, kept between runs: a configuration is then composed, and refused, without
importing what it is made of, which takes longer than all else."""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from workbench.digest import code_digest
from workbench.files import NotWrittenError, whole_file
from workbench.kernel_cache import kept_folder

_PACKAGE = Path(__file__).parents[1]
_OURS = f"{_PACKAGE.name}."


def kept_keys(target: str, describe: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return what `describe` says of a part, strings, numbers, lists and mappings of them; as it said to an earlier
    process, where no source of the workbench has changed since. Of parts of other packages nothing is kept."""
    if not target.startswith(_OURS):
        return describe()
    path = kept_folder(_PACKAGE) / "keys" / f"{target}.json"
    with suppress(OSError, ValueError, KeyError, TypeError):  # missing, or not what was written here
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["code"] == _code():
            return dict(kept["told"])
    told = describe()
    if json.loads(json.dumps(told)) == told:
        with suppress(NotWrittenError, OSError), whole_file(path, parents=True) as part:
            part.write_text(json.dumps({"code": _code(), "told": told}), encoding="utf-8")
    return told


@cache
def _code() -> str:
    return code_digest()
