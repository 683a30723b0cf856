"""The one exception for input that a person can mend."""


class InputError(ValueError):
    """Bad input: one sentence with the file, the place, what was expected and what was found.

    The command line prints the sentence without a traceback and exits with code 2.
    """
