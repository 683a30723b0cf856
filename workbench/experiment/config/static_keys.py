"""The keys of components and the chosen options, read from their sources: importing a component takes seconds."""

import ast
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.experiment.config.options import GROUPS, OURS, Option, find, folder, folder_of, folders, options
from workbench.utils.input_limits import parse_yaml


def chosen_options(overrides: Mapping[str, str]) -> dict[str, str]:
    """Return the option of each group by the defaults lists of `config.yaml` and the experiment, and by overrides.

    Interpolations are not resolved. Raises InputError for a file that is no YAML.
    """
    top = _content(folder(OURS) / "config.yaml")
    chosen = {**_defaults(top), **overrides}
    return {**chosen, **_of_experiment(chosen.get("experiment", "")), **overrides}


def _of_experiment(name: str) -> dict[str, str]:
    """Return the options that an experiment's defaults list chooses, or those of its base experiments."""
    path = find(folders().values(), f"experiment/{name}.yaml")
    content = {} if path is None else _content(path)
    bases = [
        entry for entry in content.get("defaults") or () if isinstance(entry, str) and entry not in ("_self_", name)
    ]
    inherited = {group: option for base in bases for group, option in _of_experiment(base).items()}
    return inherited | _defaults(content)


def _defaults(content: Mapping[str, Any]) -> dict[str, str]:
    entries = [entry for entry in content.get("defaults") or () if isinstance(entry, dict)]
    return {key.split()[-1].lstrip("/"): str(option) for entry in entries for key, option in entry.items()}


def _content(path: Path) -> dict[str, Any]:
    content = parse_yaml(path, path.read_text(encoding="utf-8"))
    return content if isinstance(content, dict) else {}


def sections() -> dict[str, Any]:
    """Return the keys and values of `config.yaml`, without Hydra's own."""
    content = _content(folder(OURS) / "config.yaml")
    return {key: value for key, value in content.items() if key not in ("defaults", "hydra", *GROUPS)}


def component_keys(option: Option, place: Sequence[str] = ()) -> list[str]:
    """Return the keys of an option's class, or of the component at a place in it, such as ("filter", "algorithm").

    They are the parameters of its constructor that have a note or a value in an option of its class; the run sets the
    others. Raises InputError for an option that is no YAML.
    """
    content = parse_yaml(option.name, option.text)
    for key in place:
        content = content.get(key) if isinstance(content, dict) else None
    if not isinstance(content, dict):
        return []
    target = content.get("_target_")
    if target is None:
        return list(content)
    users = [each for group in GROUPS for each in options(group).values() if str(target) in each.text]
    known = {*content, *(note.rpartition(".")[2] for each in users for note in each.all_notes)}
    return [name for name in _parameters(str(target)) if name in known]


def _parameters(target: str) -> list[str]:
    """Return the parameters of a class or function by its dotted name, from the source of its module; none if it has no
    source."""
    module, _, name = target.rpartition(".")
    package, *path = module.split(".")
    source = folder_of(package).joinpath(*path)
    file = next((each for each in (source.with_suffix(".py"), source / "__init__.py") if each.is_file()), None)
    if file is None:
        return []
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            return _arguments(node)
        if isinstance(node, ast.ClassDef) and node.name == name:
            return list(dict.fromkeys(_of_class(node, tree, module)))
        if isinstance(node, ast.ImportFrom) and any((each.asname or each.name) == name for each in node.names):
            return _parameters(f"{node.module}.{name}")
    return []


def _of_class(node: ast.ClassDef, tree: ast.Module, module: str) -> Iterator[str]:
    """Yield the parameters of a constructor, or the fields of a data class after those of its bases."""
    for method in node.body:
        if isinstance(method, ast.FunctionDef) and method.name == "__init__":
            yield from _arguments(method)
            return
    for base in node.bases:
        if isinstance(base, ast.Name):
            local = next((each for each in tree.body if isinstance(each, ast.ClassDef) and each.name == base.id), None)
            yield from _parameters(f"{module}.{base.id}") if local is None else _of_class(local, tree, module)
    for field in node.body:
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            yield field.target.id


def _arguments(function: ast.FunctionDef) -> list[str]:
    arguments = function.args
    return [each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs) if each.arg != "self"]
