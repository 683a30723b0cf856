"""Errors as a person reads them: one sentence, what was meant, and what there is, a line each."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches

_OPTION = re.compile(r"Could not (?:find|load) '(\w+)/([^']*)'")
_KEY = re.compile(r"Key '([^']+)' not in '")
_PLACE = re.compile(r"full_key: (\S+)")
_IN = re.compile(r"In '(\w+)/([^',]+)[^']*':(?: \w+ raised while composing config:)?")
_COMPONENT = re.compile(r"object_type=(\w+)_keys")
_WORD = re.compile(r"([a-z]\w*)=(.*)", re.DOTALL)
_MOST = 40


def lines(error: BaseException) -> list[str]:
    """Return the error and, for Hydra's wrappers, its cause, in one line without Hydra's hints on debugging. Of an
    option or a key that there is none of it says what was meant, and before it stands what there is, a line each."""
    chain = list(_causes(error))
    texts: list[str] = []
    for cause in chain:
        text = " ".join(str(cause).split())
        if isinstance(cause, OSError) and cause.filename:
            text = f"{cause.filename}: {cause.strerror}"
        if text and not any(text in part for part in texts):
            texts.append(text)
    whole = ": ".join(texts)
    if place := _IN.search(whole):
        file = _file(*place.groups())
        whole = whole.replace(place[0], file)
        *there, sentence = _meant(whole, chain, place[2])
        return [*there, sentence if sentence.startswith(file) else f"{file} {sentence}"]
    return _meant(whole, chain)


def _file(group: str, name: str) -> str:
    """Return the file of an option, and a colon."""
    from workbench.experiment.config.options import find, folders

    name = f"{'experiment' if group == 'when' else group}/{name}"
    return f"{find(folders().values(), f'{name}.yaml') or name}:"


def _meant(whole: str, chain: Sequence[BaseException], experiment: str = "") -> list[str]:
    """Return what there is in place of an unknown option or key, and a sentence on it; any other error as it is.

    experiment: whose file names it.
    """
    if found := _OPTION.search(whole):
        return _no_option(found[1], found[2])
    if not (found := _KEY.search(whole)):
        return [whole]
    place, there, component = _PLACE.search(whole), _keys(chain), _COMPONENT.search(whole)
    name = place[1] if place else found[1]
    group, before = name.partition(".")[0], name.rpartition(".")[0]
    if experiment and component and not get_close_matches(found[1], there):
        return [
            f"the chosen {group} ({component[1]}) has no key {name}; "
            f"choose experiment=custom with {group}=…, or leave the {group} to experiment={experiment}"
        ]
    return _unknown(f"there is no key {name}", found[1], there, f"{before}." if before else "") if there else [whole]


def mistyped(arguments: Sequence[str]) -> list[str]:
    """Tell of the first `group=option` or `key=value` of which there is none, as `lines` does; empty where all are.

    It is what Hydra would say once it has imported the parts of the run. Left to it is whatever is not as plain: keys
    within parts, choices of a sweep, and all where a folder with other options is named.
    """
    from workbench.experiment.config.options import GROUPS, options
    from workbench.experiment.config.schema import RunSchema

    others = [text for text in arguments if text not in ("-m", "--multirun")]
    if any("=" not in text or text.startswith("-") for text in others):
        return []
    groups, keys = ("experiment", "paper", *GROUPS), {"experiment", *(each.name for each in fields(RunSchema))}
    for found in filter(None, map(_WORD.fullmatch, arguments)):
        name, value = found.groups()
        if name in groups and re.fullmatch(r"[a-zA-Z]\w*", value) and value.lower() != "null":
            if value not in options(name):
                return _no_option(name, value)
        elif name not in (*keys, "hydra", "when"):
            return _unknown(f"there is no key {name}", name, sorted(keys), "")
    return []


def _no_option(group: str, name: str) -> list[str]:
    from workbench.experiment.config.options import options

    return _unknown(f"{group}: there is no option {name!r}", name, sorted(options(group)), f"{group}=")


def _unknown(told: str, name: str, there: Sequence[str], before: str) -> list[str]:
    """List what there is, and say what was meant."""
    near = get_close_matches(name, there, n=3, cutoff=0.6)
    meant = f"; did you mean {' or '.join(before + each for each in near)}?" if near else ""
    listed = [f"  {before}{each}" for each in there[:_MOST]]
    more = [f"  and {len(there) - _MOST} more"] if len(there) > _MOST else []
    return ["there are:", *listed, *more, f"{told}{meant}"]


def _keys(chain: Sequence[BaseException]) -> list[str]:
    """Find the keys that the place of an unknown one has."""
    for cause in chain:
        kind = getattr(cause, "object_type", None)
        if isinstance(kind, type) and is_dataclass(kind):
            return sorted(field.name for field in fields(kind) if not field.name.startswith("_"))
    return []


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
