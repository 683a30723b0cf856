"""Random damage to files, and the property of all readers: they return or raise InputError in time."""

import time

from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.utils.errors import LONGEST, InputError

TIME_LIMIT_S = 5.0
TOKENS = (
    b"nan", b"inf", b"-1", b"0", b"1e300", b"-1e18", b"9" * 30, b"9" * 5000, b"[" * 3000, b"{" * 3000, b"a." * 3000,
    b"(" * 2000, b"\x00", b"\xff\xfe", "\u2028é٣".encode(), b"\xed\xa0\x80", b"\n", b"\t" * 50, b'"', b"'" * 3, b",",
    b":", b"}", b"]", b"&a [*a, *a]", b"!!python/object:os.system {}", b"!!int ''", b"!!bool x", b"2026-01-01",
    b"!!binary aGk=", b"null", b"true", b"#", b"1_000", b"x" * 200_000, b"- " * 500, b"? ", b"1" + b"0" * 400,
    b"\\ud800", b"..", b"~", bytes(8), b"\xff" * 8,
)  # fmt: skip
KINDS = ("truncate", "flip a bit", "insert a token", "replace a word", "swap lines", "remove", "repeat", "overwrite")

place = st.floats(0.0, 1.0, exclude_max=True)
changes = st.lists(st.tuples(st.sampled_from(KINDS), place, place, st.sampled_from(TOKENS)), min_size=1, max_size=4)
flips = st.lists(st.tuples(st.sampled_from(("flip a bit", "overwrite")), place, place, st.sampled_from(TOKENS[-2:])),
                 min_size=1, max_size=8)  # fmt: skip
"""Damage that changes little of a binary file."""


def damaged(content, chosen):
    """Return the content with the chosen changes."""
    for kind, place, size, token in chosen:
        content = _changed(content, kind, int(place * len(content)), size, token) if content else token
    return content


def _changed(content, kind, at, size, token):
    span = 1 + int(size * len(content) / 4)
    if kind == "swap lines":
        lines = content.split(b"\n")
        a, b = at % len(lines), int(size * len(lines))
        lines[a], lines[b] = lines[b], lines[a]
        return b"\n".join(lines)
    if kind == "replace a word":
        words = content.split(b" ")
        words[at % len(words)] = token
        return b" ".join(words)
    return {
        "truncate": content[:at],
        "flip a bit": content[:at] + bytes([content[at] ^ 1 << int(8 * size)]) + content[at + 1 :],
        "insert a token": content[:at] + token + content[at:],
        "remove": content[:at] + content[at + span :],
        "repeat": content[: at + span] + content[at:],
        "overwrite": content[:at] + token + content[at + len(token) :],
    }[kind]


def refusal(read, *arguments):
    """Return the message of the InputError that a reader raises in time, "" if it returns."""
    began, message = time.process_time(), ""
    try:
        read(*arguments)
    except InputError as error:
        message = str(error)
    assert time.process_time() - began < TIME_LIMIT_S
    assert len(message) <= LONGEST
    assert "\n" not in message
    return message


def withstands(read, path, n=100, strategy=changes):
    """Check that a reader reads the valid file at `path`, and reads or rejects n damaged versions of it."""
    content = path.read_bytes()
    read(path)

    @given(strategy)
    @settings(max_examples=n)
    def reads_or_rejects(chosen):
        path.write_bytes(damaged(content, chosen))
        refusal(read, path)

    reads_or_rejects()
