"""The commands that bring a run's code and configuration back, and what of it is gone."""

import hashlib
import os
import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.experiment.config.identity import input_files
from workbench.experiment.provenance import CUT, has_commit
from workbench.experiment.summary import versions
from workbench.recording.read.reader import Run
from workbench.utils.errors import InputError

_COMMIT = re.compile("[0-9a-f]{7,64}")


def restore(run: Run, root: Path) -> tuple[list[str], list[str]]:
    """Commands for a shell in the clone at `root`, and sentences of what they do not bring back.

    The difference of the code is taken out of the recording again by `workbench runs --changes`.
    """
    origin, commands = run.provenance, list[str]()
    if commit := _commit(origin):
        folder = f"../{root.name}-{commit[:9]}"
        commands.append(f"git worktree add {shlex.quote(folder)} {commit}")
        commands.append(f"cd {shlex.quote(folder)}")
        if origin.get("difference"):
            recording = shlex.quote(os.path.relpath(run.path.resolve(), root.parent / folder.removeprefix("../")))
            commands.append(f"workbench runs --changes {recording} | git apply")
        commands.append("python3 -m venv .venv && .venv/bin/pip install -q -c requirements.lock -e .")
    if words := _command(origin):
        legacy = not commit and words[1:2] != ["run"]  # recorded by a version whose command was `workbench KEY=VALUE`
        program = ".venv/bin/workbench" if commit else "workbench"
        commands.append(shlex.join([program, *(["run"] if legacy else []), *words[1:]]))
    else:
        commands.append(f"workbench check {shlex.quote(str(run.path))}")
    return commands, [*_gone(origin, root), *_inputs(run)]


def _commit(origin: Mapping[str, Any]) -> str:
    """The recorded commit; empty where none was recorded, or something else, which no shell is to be given."""
    commit = str(origin.get("commit", ""))
    return commit if _COMMIT.fullmatch(commit) else ""


def _command(origin: Mapping[str, Any]) -> list[str]:
    """The words of the recorded command; none where it is not one line that starts the workbench."""
    command = str(origin.get("command", ""))
    try:
        words = shlex.split(command)
    except ValueError:
        return []
    return words if words[:1] == ["workbench"] and command.isprintable() else []


def _gone(origin: Mapping[str, Any], root: Path) -> Iterator[str]:
    if not _command(origin):
        none = "the recorded command is none of the workbench's" if origin.get("command") else "no command was recorded"
        yield f"{none}: the recorded configuration is run again and compared"
    if origin.get("difference"):
        yield "the code's difference comes with the recording: read it (--changes) before it is applied and run"
    if not (commit := _commit(origin)):
        yield "which code made it is not known: it was installed without a clone, or is older than that was recorded"
    elif not has_commit(root, commit):
        yield f"commit {commit[:9]} is not in this clone: fetch it first"
    if str(origin.get("difference", "")).endswith(CUT):
        yield "the code's difference was too long and is cut off"
    lock = root / "requirements.lock"
    if "lock" in origin and not (lock.is_file() and hashlib.sha256(lock.read_bytes()).hexdigest() == origin["lock"]):
        yield "requirements.lock is another one today; that commit has its own"
    now = versions()
    other = [name for name in now if origin.get(name, now[name]) != now[name]]
    if other:
        yield "it was made with " + ", ".join(f"{name} {origin[name]} (here {now[name]})" for name in other)


def _inputs(run: Run) -> Iterator[str]:
    """Tell which inputs are gone, or are not what they were."""
    told = run.provenance.get("inputs") or []
    try:
        today = input_files(OmegaConf.create(run.settings))
    except (InputError, OmegaConfBaseException, AttributeError, TypeError, ValueError) as error:
        yield f"its inputs cannot be told: {' '.join(str(error).split())[:200]}"
        return
    for each in [told] if isinstance(told, str) else told:
        name, _, digest = str(each).rpartition(" ")
        if name not in today:
            yield f"{name}: is not found any more"
        elif today[name] != digest:
            yield f"{name}: is not what it was"
