"""Exceptions with messages for the user."""

LONGEST = 300
"""Maximum length of a message, characters: quoted input may have millions."""

_TAIL = 120


def shortened(message: str) -> str:
    """Return a message of at most LONGEST characters, cut in its middle; invalid characters are escaped."""
    text = message[: 2 * LONGEST] + message[2 * LONGEST :][-LONGEST:]
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return text if len(text) <= LONGEST else f"{text[: LONGEST - _TAIL - 3]} … {text[-_TAIL:]}"


class InputError(ValueError):
    """Bad input: a message with the file, the place, the expected and the actual value.

    The command line prints the message, of at most LONGEST characters, without a traceback and exits with code 2.
    """

    def __init__(self, message: str) -> None:
        super().__init__(shortened(message))


class RunFailure(RuntimeError):  # noqa: N818 - an outcome of a run, not a wrong input
    """A failed run: the command line prints the message without a traceback and exits with code 1."""
