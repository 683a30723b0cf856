"""The type of parameters that name a file or a folder to read."""

from typing import Annotated

InputPath = Annotated[str, "file or folder to read"]
"""A text that names a file or a folder. A recorded configuration may only name one below paths.data."""
