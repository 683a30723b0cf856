"""workbench-parts: what can be chosen, and what the keys of an option are."""

import argparse
import inspect
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence

from workbench.experiment.config.options import GROUPS, OURS, Option, name_parts, options, packages, parts_in
from workbench.utils.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """List the options of all groups, or the keys of those named. Returns 0, or 2 for a name that is none."""
    parser = argparse.ArgumentParser(prog="workbench-parts", description=__doc__)
    parser.add_argument(
        "what", metavar="GROUP|GROUP.OPTION|parts=[PACKAGE]", nargs="*",
        help="what to show, such as prior.jitter; nothing: all options. parts=[my_parts]: those of a package, too",
    )  # fmt: skip
    parser.add_argument("--table", action="store_true", help="what goes with what, and what is lacking elsewhere")
    arguments = parser.parse_args(argv)
    try:
        name_parts(parts_in(arguments.what))
        chosen = [text for text in arguments.what if "=" not in text]
        if arguments.table:
            print(_combinations())
        else:
            print("\n\n".join(map(_described, chosen)) if chosen else listing())
    except InputError as error:
        print(f"workbench-parts: {error}", file=sys.stderr)
        return 2
    return 0


def listing() -> str:
    """Every group with its options and what they are, one line each."""
    groups = [group for group in ("experiment", "paper", *GROUPS) if options(group)]
    return "\n\n".join(f"{group}=\n{_table(_abouts(group), lines=1)}" for group in groups)


def _combinations() -> str:
    """Which options go with which, and what the others lack; wrappers as they stand, with the parts they begin with."""
    from workbench.experiment.config.requirements import PAIRS, table, traits_of
    from workbench.experiment.config.schema import composed

    named, groups = f"parts=[{','.join(packages()[1:])}]", {group for pair in PAIRS for group in pair}
    traits = {
        group: {
            name: traits_of(composed(["experiment=custom", named, f"{group}={name}"])[group]) for name in options(group)
        }
        for group in groups
    }
    told = "\n\n".join(f"{title}\n{_table(rows)}" for title, rows in table(traits).items())
    return f"{told}\n\nOptions as they stand; a video with marks or joints, for example, has a start and 2-D joints."


def _abouts(group: str) -> dict[str, str]:
    return {
        name: option.about + ("" if option.package == OURS else f" [{option.package}]")
        for name, option in options(group).items()
    }


def _described(place: str) -> str:
    """An option's class, what that says of itself, and its keys with defaults and notes."""
    group, _, name = place.partition(".")
    if group not in ("experiment", "paper", *GROUPS) or (name and name not in options(group)):
        raise InputError(f"expected a group or group.option, such as prior.jitter, found {place!r}")
    if not name:
        return f"{group}=\n{_table(_abouts(group))}"
    option = options(group)[name]
    if option.target is None:
        return f"{place}\n{option.text.rstrip()}"
    from workbench.experiment.config.instantiate import (
        resolved,  # here and below, so that a list of options imports none of them
    )

    first, _, _ = (inspect.getdoc(resolved(option.target)) or "").partition("\n\n")
    paragraph = f"{option.target}: {' '.join(first.split())}"
    return f"{place}: {option.about}\n\n{paragraph}\n\n{_table(_keys(option))}"


def _keys(option: Option) -> dict[str, str]:
    """Key = value, as the option has it or else its class, and the note on it."""
    from omegaconf import OmegaConf

    from workbench.experiment.config.instantiate import keys_of, resolved

    own: Mapping[str, object] = OmegaConf.to_container(OmegaConf.create(option.text))  # type: ignore[assignment]
    found, notes = {}, option.notes
    for key, (_, default) in keys_of(resolved(str(option.target))).items():
        value = own.get(key, "expected" if default is inspect.Parameter.empty else default)
        shown = "null" if value is None else list(value) if isinstance(value, tuple) else value
        found[f"{key}: {shown}"] = notes.get(key, "")
    return found


def _table(rows: Mapping[str, str], lines: int | None = None) -> str:
    """Two columns, the second wrapped to the terminal, to at most so many lines."""
    width = min(max(map(len, rows), default=0), 28)
    room = max(shutil.get_terminal_size((120, 24)).columns - width - 4, 40)
    found = []
    for left, right in rows.items():
        first, *more = textwrap.wrap(right, room, max_lines=lines, placeholder=" …") or [""]
        found.append(f"  {left:<{width}}  {first}".rstrip())
        found += [f"  {'':<{width}}  {text}" for text in more]
    return "\n".join(found)
