"""The format of recordings and summaries: the names of their paths, properties, metrics and configuration keys."""

from workbench.utils.errors import InputError

FORMAT = 4
"""Number of the format, in the property `run` of a recording and in summary.json; other formats are not read."""


def check_format(place: object, number: object, workbench: object) -> None:
    """Raise InputError, with the version of the workbench that wrote it, for a recording or summary of another format.

    Parameters
    ----------
    place : of the recording or summary, for the message.
    number : of its format; None: without a number, as in format 1.
    workbench : the version of the workbench that wrote it; None: unknown.
    """
    if number != FORMAT:
        version = "an unknown version of workbench" if workbench is None else f"workbench {workbench}"
        raise InputError(
            f"{place}: expected format {FORMAT}, found format {1 if number is None else number}, written by {version}; "
            "repeat its experiment, or use that version"
        )
