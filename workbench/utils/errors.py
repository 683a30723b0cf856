"""The one exception for input that a person can mend."""

LONGEST = 300
"""Characters of a sentence: what it quotes may have millions."""

_TAIL = 120


def shortened(sentence: str) -> str:
    """Cut a sentence in its middle, so that it has at most LONGEST characters; what is no text in it is escaped."""
    text = sentence[: 2 * LONGEST] + sentence[2 * LONGEST :][-LONGEST:]
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return text if len(text) <= LONGEST else f"{text[: LONGEST - _TAIL - 3]} … {text[-_TAIL:]}"


class InputError(ValueError):
    """Bad input: one sentence with the file, the place, what was expected and what was found.

    The command line prints the sentence, of at most LONGEST characters, without a traceback and exits with code 2.
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(shortened(sentence))


class RunFailure(RuntimeError):  # noqa: N818 - an outcome of a run, not a wrong input
    """A run that cannot go on: the command line prints its message without a traceback and exits with code 1."""
