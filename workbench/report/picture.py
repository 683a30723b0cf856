"""A plot as it goes into a report."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """A plot as PNG. name: of its file. caption: what is to be seen, one or two sentences."""

    name: str
    title: str
    caption: str
    png: bytes
