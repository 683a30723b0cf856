"""Shell completion of the arguments of `workbench run`: groups, options and keys.

Nothing of Hydra or of a component is imported, so that a shell answers at once.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

import typer

from workbench.experiment.config.options import GROUPS, allow_packages, options, packages_in, set_config_dirs
from workbench.experiment.config.static_keys import chosen_options, component_keys, sections
from workbench.utils.errors import InputError

app = typer.Typer(add_completion=False)
"""`workbench run` as a shell completes it, without the imports of the command."""

_CHOICES = ("experiment", "paper", *GROUPS)
_PREFIX = re.compile(r"\+{0,2}|~")


def completions(word: str, words: Sequence[str]) -> list[str]:
    """Return what continues a word of `workbench run`: groups, options after `GROUP=`, keys after `GROUP.`.

    Parameters
    ----------
    word : the incomplete word, such as `prior=` or `dataset.`; in a list of options the last one is completed.
    words : the other words of the command line, which choose options and packages.

    Returns
    -------
    Words that begin with `word`; none where the words before or a file are wrong, which the run itself reports.
    """
    try:
        allow_packages(packages_in(words))
        set_config_dirs(words)
        prefix = _PREFIX.match(word)[0]  # type: ignore[index]  # matches any word
        rest = word.removeprefix(prefix)
        key, sign, value = rest.partition("=")
        candidates = _options(key, value) if sign else _keys(rest, words)
        found = [prefix + text for text in candidates if text.startswith(rest)]
    except (InputError, OSError, SyntaxError, UnicodeDecodeError):
        return []  # a message would appear in the middle of the line
    if len(found) == 1 and found[0] != word:  # a shell ends the only word with a space
        return completions(found[0], words) or found
    return found


def _options(group: str, value: str) -> Iterator[str]:
    """Yield `group=option` for each option, after those of a list that are complete; also of `group@place`."""
    before, name = value[: value.rfind(",") + 1], group.partition("@")[0]
    yield from (f"{group}={before}{option}" for option in (options(name) if name in _CHOICES else ()))


def _keys(word: str, words: Sequence[str]) -> Iterator[str]:
    """Yield the groups and keys at the level of a word: the top, a section, or a component."""
    *path, _ = word.split(".")
    if not path:
        yield from (f"{group}=" for group in _CHOICES)
        yield from (f"{group}." for group in GROUPS)
        yield from _nested(path, sections())
    elif path[0] in GROUPS:
        yield from _component(path, words)
    else:
        node: Any = sections()
        for key in path:
            node = node.get(key) if isinstance(node, Mapping) else None
        yield from _nested(path, node or {})


def _component(path: Sequence[str], words: Sequence[str]) -> Iterator[str]:
    """Yield the keys of a group's chosen option, or of a component in it."""
    group, *place = path
    overrides = dict(text.lstrip("+").split("=", 1) for text in words if "=" in text)
    option = options(group).get(chosen_options(overrides).get(group, "").rpartition(",")[2])
    for key in () if option is None else component_keys(option, place):
        yield f"{'.'.join(path)}.{key}{'.' if option and component_keys(option, [*place, key]) else '='}"


def _nested(path: Sequence[str], node: Mapping[str, Any]) -> Iterator[str]:
    for key, value in node.items():
        yield f"{'.'.join([*path, str(key)])}{'.' if isinstance(value, Mapping) and value else '='}"


def _words(context: typer.Context, args: list[str], incomplete: str) -> list[str]:
    """Return the completions of typer's incomplete word, which in Bash begins after `=`, where it ends words."""
    if "COMP_WORDS" not in os.environ:
        return completions(incomplete, [str(word) for word in context.params.get("overrides") or ()])
    typed = re.split(r"[ \n]", os.environ["COMP_WORDS"])[: int(os.environ["COMP_CWORD"]) + 1]
    *words, word = re.sub(r"\n?=\n?", "=", "\n".join(typed)).split("\n")
    before = word.removesuffix(incomplete)
    return [text.removeprefix(before) for text in completions(word, words)]


@app.command(context_settings={"ignore_unknown_options": True})
def run(overrides: Annotated[list[str] | None, typer.Argument(autocompletion=_words)] = None) -> None:
    """Complete the words of `workbench run`."""
