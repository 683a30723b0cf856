"""Run commands on mutated inputs: `python -m analysis.fuzz --n 2000 --seed 0`.

Each case changes one file, or one argument, of a valid command and runs it in a forked process. Bad are cases that end
by an exception or a signal, after more than SECONDS or with more than BYTES of memory. They are listed by their cause.
"""

import argparse
import importlib
import multiprocessing
import os
import pkgutil
import random
import re
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

import workbench

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests" / "scenes"))  # where the tests keep valid files
_scenes = importlib.import_module("command_inputs")

SECONDS, BYTES, OPENED_BYTES = 60.0, 2e9, 16 << 30
NUMBERS = (
    "nan", "inf", "-inf", "1e308", "-1", "0", "-0.0", "1e-308", "2147483648", "x", "1,5", "null", "9" * 30, "", '"',
)  # fmt: skip
WORDS = (
    "null", "[]", "{}", "''", "../..", "/dev/null", "~", "~x", "${a}", "*", "é٣", "%s", "1e999", "", "\0", "a" * 5000,
)  # fmt: skip
NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
KEY = re.compile(rb"[A-Za-z_][\w.-]+")
ENCODINGS = ("utf-16", "utf-8-sig", "utf-32", "cp037")
KINDS = (
    "truncate", "byte", "bytes", "remove line", "repeat line", "swap lines", "encode", "empty", "double", "remove part",
    *("number",) * 6, *("key",) * 3,
)  # fmt: skip
SLOW = ("run", "track", "check", "report", "export", "measure")
"""Commands that are drawn less often."""
PLACES = ("missing", "a folder", "a pipe", "a link to itself", "a device")


class Case(NamedTuple):
    """A command and the change of its input; outcome: the exit code, or why the case is bad."""

    number: int
    command: str
    change: str
    outcome: str = ""


def changed_text(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """Return mutated content and the name of the mutation."""
    at, lines = rng.randrange(len(content) or 1), content.splitlines(keepends=True) or [b""]
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.choice(KINDS)
    if kind in ("number", "key"):
        found = list((NUMBER if kind == "number" else KEY).finditer(content[:1_000_000]))
        if not found:
            return b"", "empty"
        match = rng.choice(found[: rng.choice((5, 50, len(found)))])  # the header more often
        new, what = rng.choice(NUMBERS if kind == "number" else WORDS), f"{kind} {match[0][:20]!r} to "
        return content[: match.start()] + new.encode() + content[match.end() :], f"{what}{new[:20]!r}"
    if kind == "swap lines":
        lines[a], lines[b] = lines[b], lines[a]
    return {
        "truncate": content[:at],
        "byte": content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :],
        "bytes": bytes(rng.randrange(256) if rng.random() < 0.01 else byte for byte in content),
        "remove line": b"".join(lines[:a] + lines[a + 1 :]),
        "repeat line": b"".join(lines[:a] + lines[a : a + 1] * 2 + lines[a + 1 :]),
        "swap lines": b"".join(lines),
        "encode": content.decode("latin-1").encode(rng.choice(ENCODINGS)),
        "empty": b"",
        "double": content * 2,
        "remove part": content[:at] + content[at + rng.randrange(1, 400) :],
    }[kind], f"{kind} at {at}, lines {a} and {b}"


def change(folder: Path, command: str, rng: random.Random) -> tuple[list[str], str]:
    """Change a file or an argument of a command in a folder; return the arguments and what was changed."""
    arguments, files = _scenes.COMMANDS[command]
    if rng.random() < 0.15 or not files:
        return changed_arguments(list(arguments), rng)
    file = rng.choice([path for pattern in files for path in sorted(folder.glob(pattern))])
    name = str(file.relative_to(folder))
    if rng.random() < 0.9:
        content = file.read_bytes()
        for _ in range(rng.choice((1, 1, 1, 3))):
            content, what = changed_text(content, rng)
        file.write_bytes(content)
        return list(arguments), f"{name}: {what}"
    kind = rng.choice(PLACES)
    file.unlink()
    if kind == "a folder":
        file.mkdir()
    elif kind == "a pipe":
        os.mkfifo(file)
    elif kind != "missing":
        file.symlink_to(file if kind == "a link to itself" else "/dev/zero")
    return list(arguments), f"{name}: {kind}"


def changed_arguments(arguments: list[str], rng: random.Random) -> tuple[list[str], str]:
    """Return mutated arguments and what was changed."""
    at = rng.randrange(1, len(arguments))
    key, equals, value = arguments[at].partition("=")
    new, number = rng.choice(WORDS), rng.choice(NUMBERS)
    arguments[at : at + 1] = rng.choice(
        (
            [], [key], [f"{key}={new}"], [f"{key}={number}"], [f"{key}x{equals}{value}"], [arguments[at]] * 2, [new],
            [f"{key}={value[: rng.randrange(len(value) + 1)]}"], [f"{key}{equals}{value}{new}"], [f"+{key}={new}"],
            [f"~{key}"],
        )
    )  # fmt: skip
    arguments = [each.replace("\0", "") for each in arguments]  # of a shell
    return arguments, f"arguments {' '.join(arguments)[:300]!r}"


def run(arguments: list[str], folder: Path, log: Path) -> None:
    """Run a command in this process, with its output in a file, and end the process."""
    os.setsid()
    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_AS, (OPENED_BYTES, OPENED_BYTES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 30, 1 << 30))
    for stream, to in ((0, os.devnull), (1, log), (2, log)):
        os.dup2(os.open(to, os.O_RDWR | os.O_CREAT | os.O_TRUNC if stream == 1 else os.O_RDWR), stream)
    sys.argv = ["workbench", *arguments]
    (script,) = entry_points(group="console_scripts", name="workbench")
    try:
        code = script.load()()
    except SystemExit as end:
        code = end.code
    except BaseException:  # noqa: BLE001 - what a user would see
        traceback.print_exc()
        code = 99
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code if isinstance(code, int) else 1)


def outcome(arguments: list[str], folder: Path, log: Path) -> str:
    """Return the exit code of a command in a forked process, or why it is bad."""
    if (child := os.fork()) == 0:
        run(arguments, folder, log)
    end = time.monotonic() + 10.0 * SECONDS  # of a loaded machine; the limit is of the processor's time
    while (done := os.wait4(child, os.WNOHANG))[0] == 0 and time.monotonic() < end:
        time.sleep(0.02)
    if done[0] == 0:
        os.killpg(child, 9)
        done = os.wait4(child, 0)
    code, used = os.waitstatus_to_exitcode(done[1]), done[2]
    text = log.read_text(errors="replace")
    seconds, size = used.ru_utime + used.ru_stime, 1024.0 * used.ru_maxrss
    if code == -9 or seconds > SECONDS:
        return f"{seconds:.0f} s"
    if "Traceback (most recent call last)" in text:
        frames = [line.strip() for line in text.splitlines() if line.startswith('  File "') and "workbench/" in line]
        return f"traceback {text.strip().splitlines()[-1][:100]} | {' '.join(frames[-1:])}"
    if size > BYTES:
        return f"{size / 1e9:.1f} GB"
    may_be_1 = arguments[:1] and arguments[0] in ("run", "check", "check-calibration", "track")
    return f"exit {code}" if code in (0, 2) or (code == 1 and may_be_1) else f"bad exit {code}"


def prepare(inputs: Path) -> None:
    """Write the valid inputs of all commands in a forked process."""
    if (child := os.fork()) == 0:
        os.chdir(inputs)
        _scenes.write_inputs(inputs)
        _scenes.write_motions(inputs)
        os._exit(0)
    os.waitpid(child, 0)


def one(task: tuple[int, int, Path]) -> Case:
    """Run one case in a copy of the inputs."""
    number, seed, inputs = task
    rng = random.Random(f"{seed} {number}")
    names = sorted(_scenes.COMMANDS)
    weights = [1 if _scenes.COMMANDS[name][0][0] in SLOW else 4 for name in names]
    (command,) = rng.choices(names, weights)
    with tempfile.TemporaryDirectory(prefix="workbench-fuzz-") as copy:
        folder = Path(copy, "inputs")
        shutil.copytree(inputs, folder)
        arguments, what = change(folder, command, rng)
        return Case(number, command, what, outcome(arguments, folder, Path(copy, "log")))


def main() -> None:
    """Run the cases and print the bad ones by their cause."""
    parser = argparse.ArgumentParser(prog="python -m analysis.fuzz", description=__doc__)
    parser.add_argument("--n", type=int, default=2000, help="cases (2000)")
    parser.add_argument("--seed", type=int, default=0, help="of the cases (0)")
    parser.add_argument("--case", type=int, help="run this case only, and print its output")
    parser.add_argument("--valid", action="store_true", help="run every command on its valid input instead")
    chosen = parser.parse_args()
    for module in pkgutil.walk_packages(workbench.__path__, "workbench."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)  # once for all cases
    with tempfile.TemporaryDirectory(prefix="workbench-fuzz-") as temporary:
        os.environ |= {"WORKBENCH_CACHE": f"{temporary}/cache", "COLUMNS": "200"}
        inputs = Path(temporary, "inputs")
        inputs.mkdir()
        prepare(inputs)
        if chosen.valid:
            for name, (arguments, _) in _scenes.COMMANDS.items():
                print(name, outcome(arguments, inputs, Path(temporary, "log")), flush=True)
            return
        tasks = [(number, chosen.seed, inputs) for number in ([chosen.case] if chosen.case else range(chosen.n))]
        with multiprocessing.Pool() as pool:
            cases = []
            for case in tqdm(pool.imap_unordered(one, tasks), total=len(tasks)):
                cases.append(case)
                if not case.outcome.startswith("exit"):
                    print(f"{case.number} {case.command}: {case.change}: {case.outcome}", flush=True)
    outcomes = Counter(case.outcome for case in cases)
    print(f"{len(cases)} cases:", *(f"{count} {name}" for name, count in outcomes.most_common()), sep="\n  ")


if __name__ == "__main__":
    main()
