"""`workbench components`: list the experiments and components, and the keys of an option."""

import inspect
import shutil
import textwrap
from collections.abc import Callable, Mapping
from typing import Annotated

import typer

from workbench.experiment.config.options import GROUPS, OURS, Option, allow_packages, options, packages, packages_in
from workbench.utils.errors import InputError

_GROUPS = ("experiment", "paper", *GROUPS)


def components(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="GROUP|GROUP.OPTION",
            help="Groups or options to list; component_packages=\\[my_components] adds a package.",
        ),
    ] = None,
    table: Annotated[
        bool, typer.Option("--table", help="List which options are compatible, and the unmet requirements.")
    ] = False,
) -> None:
    """List the experiments and components that can be chosen, or the keys of one.

    Examples:
      workbench components experiment
      workbench components prior.ar_offsets
    """
    names = names or []
    allow_packages(packages_in(names))
    chosen = [name for name in names if "=" not in name]
    if table:
        print(_combinations())
    else:
        print("\n\n".join(map(_described, chosen)) if chosen else listing())


def listing() -> str:
    """Return every group with its options and their summaries, one line each."""
    return "\n\n".join(_options_of(group, lines=1) for group in _GROUPS if options(group))


def _options_of(group: str, lines: int | None = None) -> str:
    rows = {
        name: option.about + ("" if option.package == OURS else f" [{option.package}]")
        for name, option in options(group).items()
    }
    return f"{group}=\n{_table(rows, lines)}"


def _combinations() -> str:
    """Return the compatible options of all pairs of groups, and the unmet requirements of the others."""
    from workbench.experiment.config.requirements import PAIRS, table, traits_of
    from workbench.experiment.config.schema import composed

    named, groups = f"component_packages=[{','.join(packages()[1:])}]", {group for pair in PAIRS for group in pair}
    traits = {
        group: {
            name: traits_of(composed(["experiment=custom", named, f"{group}={name}"])[group]) for name in options(group)
        }
        for group in groups
    }
    text = "\n\n".join(f"{title}\n{_table(rows)}" for title, rows in table(traits).items())
    return f"{text}\n\nWith default keys; a video with annotations or joints also provides a start and 2-D joints."


def _described(place: str) -> str:
    """Return an option's class, the first paragraph of its docstring, and its keys with defaults and notes."""
    group, _, name = place.partition(".")
    if group not in _GROUPS or (name and name not in options(group)):
        raise InputError(f"expected a group or group.option, such as prior.ar_offsets, found {place!r}")
    if not name:
        return _options_of(group)
    option = options(group)[name]
    if option.target is None:
        return f"{place}\n{option.text.rstrip()}"
    from workbench.experiment.config.instantiate import import_target  # here, as the options are listed without it

    target = import_target(option.target)
    first, _, _ = (inspect.getdoc(target) or "").partition("\n\n")
    return f"{place}: {option.about}\n\n{option.target}: {' '.join(first.split())}\n\n{_table(_keys(option, target))}"


def _keys(option: Option, target: Callable[..., object]) -> dict[str, str]:
    """Return the notes by `key: value`, with the value of the option or the default of its class."""
    from omegaconf import OmegaConf

    from workbench.experiment.config.instantiate import config_keys

    values: Mapping[str, object] = OmegaConf.to_container(OmegaConf.create(option.text))  # type: ignore[assignment]
    rows, notes = {}, option.all_notes
    for key, (_, default) in config_keys(target).items():
        value = values.get(key, "required" if default is inspect.Parameter.empty else default)
        text = "null" if value is None else list(value) if isinstance(value, tuple) else value
        rows[f"{key}: {text}"] = notes.get(key, "")
    return rows | {key: note for key, note in option.notes.items() if "." in key}


def _table(rows: Mapping[str, str], lines: int | None = None) -> str:
    """Return two columns; the second is wrapped to the terminal and truncated after `lines` lines."""
    width = min(max(map(len, rows), default=0), 28)
    room = max(shutil.get_terminal_size((120, 24)).columns - width - 4, 40)
    table = []
    for left, right in rows.items():
        first, *more = textwrap.wrap(right, room, max_lines=lines, placeholder=" …") or [""]
        table.append(f"  {left:<{width}}  {first}".rstrip())
        table += [f"  {'':<{width}}  {text}" for text in more]
    return "\n".join(table)
