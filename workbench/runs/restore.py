"""The commands that bring a run's code and configuration back, and what of it is gone."""

import hashlib
import os
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from workbench.experiment.identity import input_files
from workbench.experiment.provenance import CUT, has_commit
from workbench.experiment.summary import versions
from workbench.recording.read.reader import Run


def restore(run: Run, root: Path) -> tuple[list[str], list[str]]:
    """Commands for a shell in the clone at `root`, and sentences of what they do not bring back.

    The difference of the code is taken out of the recording again by `workbench-runs --changes`.
    """
    origin, commands = run.provenance, list[str]()
    if commit := str(origin.get("commit", "")):
        folder = f"../{root.name}-{commit[:9]}"
        commands.append(f"git worktree add {shlex.quote(folder)} {commit}")
        commands.append(f"cd {shlex.quote(folder)}")
        if origin.get("difference"):
            recording = shlex.quote(os.path.relpath(run.path.resolve(), root.parent / folder.removeprefix("../")))
            commands.append(f"workbench-runs --changes {recording} | git apply")
        commands.append("python3 -m venv .venv && .venv/bin/pip install -q -c requirements.lock -e .")
    command = str(origin.get("command", ""))
    if command:
        program = ".venv/bin/workbench" if commit else "workbench"
        commands.append(f"{program}{command.removeprefix('workbench')}")
    else:
        commands.append(f"workbench-check {shlex.quote(str(run.path))}")
    return commands, [*_gone(origin, root, bool(command)), *_inputs(run)]


def _gone(origin: Any, root: Path, has_command: bool) -> Iterator[str]:
    if not has_command:
        yield "no command was recorded: the recorded configuration is run again and compared"
    if not (commit := str(origin.get("commit", ""))):
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
    today = input_files(OmegaConf.create(run.settings))
    for each in [told] if isinstance(told, str) else told:
        name, _, digest = str(each).rpartition(" ")
        if name not in today:
            yield f"{name}: is not found any more"
        elif today[name] != digest:
            yield f"{name}: is not what it was"
