"""Run the tests on single-line mutations of the mathematics, by hand: `python tests/mutations/run.py [NAME | M-N] …`.

A mutation that no test notices says where the tests are blind. The list is mutations.toml; numbers count from 1. The
tree is copied to a temporary folder, so that nothing here changes; every mutation is made there by itself and taken
back. First the tests run on the copy as it is: one that fails without a mutation would catch everything.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).parents[2]
COPIED = ("workbench", "conf", "tests", "analysis", "pyproject.toml", "README.md", ".docs")
UNCOPIED = shutil.ignore_patterns("__pycache__")
FAST = "not slow"


@dataclass(frozen=True)
class Mutation:
    """One line made wrong: `old`, which stands once in `file`, becomes `new`. wrong: what that means. tests: files, or
    single tests, that should fail. slow: run those marked slow, too."""

    name: str
    file: str
    old: str
    new: str
    wrong: str
    tests: tuple[str, ...]
    slow: bool = False

    def flaw(self, root: Path) -> str:
        """Say why it cannot be made in the tree `root`; nothing where it can."""
        files = (self.file, *(test.partition("::")[0] for test in self.tests))
        if missing := [file for file in files if not (root / file).is_file()]:
            return f"there is no {missing[0]}"
        if "\n" in self.old + self.new or self.old == self.new:
            return "old and new must be different texts within one line"
        count = (root / self.file).read_text(encoding="utf-8").count(self.old)
        return "" if count == 1 else f"{self.old!r} stands {count} times in {self.file}, expected once"


def mutations() -> list[Mutation]:
    """Read the list."""
    rows = tomllib.loads((Path(__file__).parent / "mutations.toml").read_text(encoding="utf-8"))["mutation"]
    return [Mutation(**{**row, "tests": tuple(row["tests"])}) for row in rows]


def chosen(words: list[str]) -> list[Mutation]:
    """Pick mutations by name, number or range of numbers, M-N; all where nothing is said. Raises SystemExit."""
    every, picked = mutations(), list[Mutation]()
    names = {mutation.name: mutation for mutation in every}
    for word in words:
        first, _, last = word.partition("-")
        if word in names:
            picked.append(names[word])
        elif first.isdigit() and (last or first).isdigit():
            picked += every[int(first) - 1 : int(last or first)]
        else:
            raise SystemExit(f"expected a mutation's name or number, or M-N up to {len(every)}, found {word!r}")
    return picked if words else every


def copied(folder: Path) -> Path:
    """Copy the tree into a folder; the copy's `workbench.conf` is its own."""
    for name in COPIED:
        source, target = ROOT / name, folder / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=UNCOPIED, symlinks=True)
        else:
            shutil.copy2(source, target)
    (folder / "workbench" / "conf").symlink_to("../conf")
    return folder


def run_tests(tree: Path, tests: list[str], slow: bool, limit_s: float) -> tuple[int | None, str]:
    """Run tests in a copy; returns pytest's exit code, None for one that took too long, and the last lines it wrote.

    Kernels are kept beside the copy, in a folder by the sources they were made of (`workbench.utils.kernel_cache`).
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", *tests]
    command += ["-o", "addopts=--import-mode=importlib --strict-markers", *([] if slow else ["-m", FAST])]
    environment = os.environ | {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / ".kernels")}
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return None, ""
    return done.returncode, "\n".join((done.stdout + done.stderr).strip().splitlines()[-5:])


def judge(mutation: Mutation, tree: Path, limit_s: float) -> str:
    """Make a mutation in a copy, run its tests, and take it back."""
    if flaw := mutation.flaw(tree):
        return f"error: {flaw}"
    file = tree / mutation.file
    before, stamp = file.read_text(encoding="utf-8"), file.stat()
    file.write_text(before.replace(mutation.old, mutation.new), encoding="utf-8")
    code, last = run_tests(tree, list(mutation.tests), mutation.slow, limit_s)
    file.write_text(before, encoding="utf-8")
    os.utime(file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))  # as old as what was compiled of it
    if code is None:
        return "not run: it took too long"
    return {0: "survived", 1: "caught"}.get(code, f"error: pytest ended with {code}: {last}")


def main() -> int:
    """Print what became of each mutation and the share caught; 1 where one survived or could not be judged."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("which", nargs="*", metavar="NAME|M-N", help="mutations; all where nothing is said")
    parser.add_argument("--limit", type=float, default=900.0, metavar="S", help="for each mutation's tests")
    parser.add_argument("--unchecked", action="store_true", help="do not run the tests without a mutation first")
    given = parser.parse_args()
    picked, verdicts = chosen(given.which), Counter[str]()
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        tree = copied(Path(folder))
        if not given.unchecked:
            for slow in {mutation.slow for mutation in picked}:
                tests = sorted({test for mutation in picked if mutation.slow == slow for test in mutation.tests})
                code, last = run_tests(tree, tests, slow, given.limit * len(picked))
                if code != 0:
                    raise SystemExit(f"the tests do not pass without a mutation, pytest ended with {code}:\n{last}")
        for mutation in picked:
            began = perf_counter()
            verdict = judge(mutation, tree, given.limit)
            verdicts[verdict.partition(":")[0]] += 1
            print(f"{mutation.name:44} {perf_counter() - began:5.0f} s  {verdict}", flush=True)
    judged = verdicts["caught"] + verdicts["survived"]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
    print(f"{counts}; {verdicts['caught'] / max(judged, 1):.0%} of those judged are caught")
    return 0 if verdicts["caught"] == len(picked) else 1


if __name__ == "__main__":
    raise SystemExit(main())
