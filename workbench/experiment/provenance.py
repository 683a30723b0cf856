"""Where a run comes from, in words that bring it back: the code and what was changed in it, the command, the inputs."""

import hashlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from workbench.experiment.config.identity import input_files
from workbench.utils.processes import CAPTURED, run

CODE = ("workbench", "conf")
"""Folders of the clone that a run's numbers depend on."""
MOST_CHANGED = 100_000
"""Characters of a difference that are kept."""
CUT = "\n# cut off here: the difference is longer than what is kept\n"


@dataclass(frozen=True)
class Command:
    """What was said on the command line. overrides: as they stand there. choices: the option chosen, by group. said:
    what was said in Python instead, where no command says it.

    parent: the recording that the run branched off, by its run's id; empty where it did not. parent_frame: the frame
    from which it goes on; None where it began anew.
    """

    overrides: Sequence[str] = ()
    choices: Mapping[str, str] = field(default_factory=dict)
    parent: str = ""
    parent_frame: int | None = None
    said: str = ""

    @property
    def line(self) -> str:
        """The command, which a shell takes, or what was said in Python."""
        return self.said or shlex.join(["workbench", "run", *self.overrides])


def provenance(config: DictConfig, command: Command) -> dict[str, Any]:
    """Say what a run comes from, as flat values that are never empty.

    commit, changed, difference: see `code_state`. lock: SHA-256 of requirements.lock. inputs: "name sha256" of every
    file, folder or database that the configuration names. command, parent, parent_frame: see `Command`. choices:
    "group=option". What is not known is left out. Raises InputError for an input that cannot be read.
    """
    root = Path(__file__).parents[2]
    found: dict[str, Any] = dict(code_state(root))
    if (lock := root / "requirements.lock").is_file():
        found["lock"] = hashlib.sha256(lock.read_bytes()).hexdigest()
    inputs = [f"{name} {digest}" for name, digest in sorted(input_files(config).items())]
    parts: dict[str, Any] = {"inputs": inputs, "command": command.line if command.overrides or command.choices else ""}
    groups = [group for group in command.choices if group != "when" and not group.startswith("hydra")]
    parts |= {"choices": [f"{group}={command.choices[group]}" for group in groups], "parent": command.parent}
    found |= {name: value for name, value in parts.items() if value}
    return found | ({} if command.parent_frame is None else {"parent_frame": command.parent_frame})


@cache
def code_state(root: Path) -> dict[str, str]:
    """The commit of the clone at `root`, whether its code was changed, and the difference as `git apply` takes it.

    Of the folders CODE, files that git does not know yet included; the difference ends with CUT after MOST_CHANGED
    characters. Empty where `root` is no clone of its own, as when the workbench was installed without one, or there is
    no git.
    """
    top = _git(root, "rev-parse", "--show-toplevel")
    if not top or Path(top.strip()).resolve() != root.resolve() or not (commit := _git(root, "rev-parse", "HEAD")):
        return {}
    new = (_git(root, "ls-files", "--others", "--exclude-standard", "-z", "--", *CODE) or "").split("\0")
    parts = [_git(root, "diff", "HEAD", "--", *CODE)]
    parts += [_git(root, "diff", "--no-index", "--", "/dev/null", name) for name in new if name]
    difference = "".join(part or "" for part in parts)
    if len(difference) > MOST_CHANGED:
        difference = difference[:MOST_CHANGED] + CUT
    state = {"commit": commit.strip(), "changed": "yes" if difference else "no"}
    return state | ({"difference": difference} if difference else {})


def has_commit(root: Path, commit: str) -> bool:
    """Whether the clone at `root` holds a commit."""
    return bool(_git(root, "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"))


def _git(root: Path, *arguments: str) -> str | None:
    """What git says; None where there is no git, or it refuses. One that tells of a difference ends with code 1."""
    command = ["git", "-C", str(root), *arguments]
    try:
        done = run(command, stdout=CAPTURED, stderr=CAPTURED, timeout_s=30.0)
    except OSError:
        return None
    return done.stdout.decode(errors="replace") if done.returncode in (0, 1) else None
