"""Commands that restore a run's code and configuration, and the changes since the run."""

import hashlib
import os
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.experiment.provenance import CUT, has_commit, input_files
from workbench.experiment.summary import versions
from workbench.recording.read.reader import Run
from workbench.utils.errors import InputError


def restore(run: Run, root: Path) -> tuple[list[str], list[str]]:
    """Return shell commands for the clone at `root`, and a message for each thing that they do not restore."""
    origin = run.provenance
    commit = str(origin.get("commit", ""))
    commit = commit if re.fullmatch("[0-9a-f]{7,64}", commit) else ""  # other text is not passed to a shell
    words = _recorded_command(str(origin.get("command", "")))
    commands = []
    if commit:
        folder = f"../{root.name}-{commit[:9]}"
        commands += [f"git worktree add {shlex.quote(folder)} {commit}", f"cd {shlex.quote(folder)}"]
        if origin.get("difference"):
            recording = shlex.quote(os.path.relpath(run.path.resolve(), root.parent / folder.removeprefix("../")))
            commands.append(f"workbench runs restore --changes {recording} | git apply")
        commands.append("python3 -m venv .venv && .venv/bin/pip install -q --no-compile -c requirements.lock -e .")
    if words:
        older = not commit and words[1:2] != ["run"]  # recorded as `workbench KEY=VALUE`
        program = ".venv/bin/workbench" if commit else "workbench"
        commands.append(shlex.join([program, *["run"] * older, *words[1:]]))
    else:
        commands.append(f"workbench check {shlex.quote(str(run.path))}")
    return commands, [*_not_restored(run, root, commit, bool(words)), *_changed_inputs(run)]


def _recorded_command(command: str) -> list[str]:
    """Return the words of a command in one line that starts the workbench; [] for any other."""
    try:
        words = shlex.split(command)
    except ValueError:
        return []
    return words if words[:1] == ["workbench"] and command.isprintable() else []


def _not_restored(run: Run, root: Path, commit: str, has_command: bool) -> Iterator[str]:
    origin = run.provenance
    if not has_command:
        none = (
            "the recorded command is not one of the workbench" if origin.get("command") else "no command was recorded"
        )
        yield f"{none}: the recorded configuration is run again and compared"
    if origin.get("difference"):
        yield "the code's difference comes with the recording: read it (--changes) before it is applied and run"
    if not commit:
        yield "its code is unknown: it was installed without a clone, or an early version recorded it"
    elif not has_commit(root, commit):
        yield f"commit {commit[:9]} is not in this clone: fetch it first"
    if str(origin.get("difference", "")).endswith(CUT):
        yield "the code's difference was too long and is cut off"
    lock = root / "requirements.lock"
    if "lock" in origin and not (lock.is_file() and hashlib.sha256(lock.read_bytes()).hexdigest() == origin["lock"]):
        yield "requirements.lock has changed; the commit has its own"
    others = [f"{name} {origin[name]} (here {now})" for name, now in versions().items() if origin.get(name, now) != now]
    if others:
        yield f"it was made with {', '.join(others)}"


def _changed_inputs(run: Run) -> Iterator[str]:
    recorded = run.provenance.get("inputs") or []
    try:
        today = input_files(OmegaConf.create(run.settings))
    except (InputError, OmegaConfBaseException, AttributeError, TypeError, ValueError) as error:
        yield f"its inputs cannot be determined: {' '.join(str(error).split())[:200]}"
        return
    for each in [recorded] if isinstance(recorded, str) else recorded:
        name, _, digest = str(each).rpartition(" ")
        if name not in today:
            yield f"{name}: no longer exists"
        elif today[name] != digest:
            yield f"{name}: has changed since the run"
