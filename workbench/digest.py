"""Telling whether what a cache holds was made by the code that asks for it."""

import hashlib
from pathlib import Path
from types import ModuleType


def code_digest(*modules: ModuleType) -> str:
    """A SHA-256 over the source of modules, so that what an older version of them made is not taken for theirs."""
    digest = hashlib.sha256()
    for module in modules:
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()
