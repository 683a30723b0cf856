"""Measure which small faults the fast tests find: `python -m analysis.mutants`.

A random sample of mutants (another operator, comparison, sign or integer, a dropped term or factor) of PACKAGES is
tested in copies of the working tree: by the fast tests that call the mutated function, then by others that call its
module, until one fails. Prints the share found by package and the survivors.
"""

import argparse
import ast
import importlib
import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import pytest
from tqdm import tqdm

ROOT = Path(__file__).parents[1]
PACKAGES = ("inference", "likelihoods", "priors", "recording", "evaluation", "cameras")
TESTS = ("tests/unit", "tests/contract")
SECONDS = 30.0
"""Largest duration of each of the two groups of a mutant's tests, without faults."""
_OPERATOR = re.compile(rb"<<|>>|\*\*|//|<=|>=|==|!=|is not|not in|[-+*/<>&|]|\b(?:and|or|is|in)\b")
_SWAPS = ("+ -", "- +", "* /", "/ *", "< <=", "<= <", "> >=", ">= >", "== !=", "!= ==", "& |", "| &", "// *", "** *")
_SWAPPED = dict(pair.split() for pair in _SWAPS) | {"and": "or", "or": "and", "is": "is not", "is not": "is"}
_SWAPPED |= {"in": "not in", "not in": "in"}
_MESSAGES = re.compile(r"\b(?:log|warn|warn_once|InputError)\b")
_OUTCOMES = _FOUND, _TIME_LIMIT, _SURVIVED, _NO_TEST = "found", "time limit", "survived", "no test"


class Mutant(NamedTuple):
    """Bytes start:end of a module replaced; function: the line on which the mutated function begins, 0 for none."""

    path: str
    function: int
    line: int
    start: int
    end: int
    new: bytes


class CalledTest(NamedTuple):
    """A fast test: its duration without faults, and the functions, PATH:LINE, that it calls."""

    name: str
    seconds: float
    functions: Sequence[str]

    @property
    def file(self) -> str:
        """Its file."""
        return self.name.split("::")[0]


class _Module:
    """The source of a module, in bytes, as columns of its syntax tree count these."""

    def __init__(self, path: str, source: bytes) -> None:
        self.path, self.source = path, source
        self._lines = [0, *(match.end() for match in re.finditer(rb"\n", source))]

    def mutants(self) -> Iterator[Mutant]:
        """Yield all mutants, except in messages and annotations."""
        yield from self._mutants(ast.parse(self.source), 0)

    def _mutants(self, node: ast.AST, function: int) -> Iterator[Mutant]:
        if isinstance(node, ast.JoinedStr | ast.Raise | ast.Assert):
            return
        if isinstance(node, ast.Call) and _MESSAGES.search(ast.unparse(node.func)):
            return
        if isinstance(node, ast.FunctionDef):
            function = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        if isinstance(node, ast.expr):
            yield from (Mutant(self.path, function, node.lineno, *change) for change in self._changes(node))
        for field, value in ast.iter_fields(node):
            if field not in ("annotation", "returns", "decorator_list", "bases"):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        yield from self._mutants(child, function)

    def _changes(self, node: ast.expr) -> Iterator[tuple[int, int, bytes]]:
        match node:
            case ast.Constant(value=int(value)) if not isinstance(value, bool):
                yield *self._span(node), str(value + 1).encode()
            case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert(), operand=operand):
                yield *self._span(node), self._in_parentheses(operand)
            case ast.BinOp(left=left, right=right, op=operator):
                yield from self._swapped(left, right)
                if isinstance(operator, ast.Add | ast.Sub | ast.Mult):
                    yield *self._span(node), self._in_parentheses(left)
            case ast.Compare(left=left, comparators=[right, *_]) | ast.BoolOp(values=[left, right, *_]):
                yield from self._swapped(left, right)

    def _swapped(self, left: ast.expr, right: ast.expr) -> Iterator[tuple[int, int, bytes]]:
        end = self._span(left)[1]
        match = _OPERATOR.search(self.source, end, self._span(right)[0])
        if match and match[0].decode() in _SWAPPED:
            yield *match.span(), _SWAPPED[match[0].decode()].encode()

    def _span(self, node: ast.expr) -> tuple[int, int]:
        end_line, end = node.end_lineno or node.lineno, node.end_col_offset or node.col_offset
        return self._lines[node.lineno - 1] + node.col_offset, self._lines[end_line - 1] + end

    def _in_parentheses(self, node: ast.expr) -> bytes:
        return b"(%b)" % self.source[slice(*self._span(node))]


class _Calls:
    """Plugin of pytest that records the functions of a package that every passed test calls.

    Functions that fixtures call belong to all tests of the file, as fixtures may be shared.
    """

    def __init__(self, package: Path) -> None:
        self._prefix, self._shared = f"{package}{os.sep}", set[str]()
        self._calls, self._tests = self._shared, list[tuple[str, float, set[str]]]()

    def _trace(self, frame: Any, _event: str, _argument: Any) -> None:
        if frame.f_code.co_filename.startswith(self._prefix):
            path = frame.f_code.co_filename.removeprefix(self._prefix)
            self._calls.add(f"{path}:{frame.f_code.co_firstlineno}")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self) -> Generator[None, None, None]:
        self._calls = self._shared
        sys.settrace(self._trace)
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self) -> Generator[None, None, None]:
        self._calls = set()
        sys.settrace(self._trace)
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        sys.settrace(None)
        if report.when == "call" and report.passed:
            self._tests.append((report.nodeid, report.duration, self._calls))

    def result(self) -> list[CalledTest]:
        return [CalledTest(name, seconds, sorted(calls | self._shared)) for name, seconds, calls in self._tests]


def _in_child(task: Callable[[], int], limit_s: float) -> int | None:
    """Return the exit code of a task in a forked process; None if it ran past the limit and was killed."""
    child = os.fork()
    if child == 0:
        os.setsid()
        for stream in (0, 1, 2):
            os.dup2(os.open(os.devnull, os.O_RDWR), stream)
        os._exit(task())
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def _pytest(tree: Path, tests: Sequence[str], plugins: Sequence[object] = ()) -> int:
    os.chdir(tree)
    sys.path.insert(0, str(tree))
    os.environ |= {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / "kernels")}
    options = ("-q", "-m", "not slow", "-o", "addopts=", "--import-mode=importlib", "-p", "no:cacheprovider")
    return int(pytest.main([*options, *tests], plugins))


def _calls_of(file: str) -> list[CalledTest]:
    """Return the tests of a file that pass, in this worker's tree."""
    result = _tree / "calls.json"
    result.write_text("[]")

    def task() -> int:
        plugin = _Calls(_tree / "workbench")
        code = _pytest(_tree, [file], [plugin])
        result.write_text(json.dumps(plugin.result()))
        return code

    _in_child(task, 600.0)
    return [CalledTest(*test) for test in json.loads(result.read_text())]


def _chosen_tests(mutant: Mutant, tests: Sequence[CalledTest]) -> list[list[CalledTest]]:
    """Return the tests of one file, that of the module or that which calls the function most, and others.

    Each of the two groups takes at most SECONDS. The others call the function or, after these, its module; or, of a
    compiled function, whose calls are not recorded, a module that imports it.
    """
    function, modules = f"{mutant.path}:{mutant.function}", {mutant.path}
    if not any(function in test.functions for test in tests):
        imported = re.compile(rf"import.*\b{Path(mutant.path).stem}\b|\b{Path(mutant.path).stem} import")
        paths = (ROOT / "workbench").rglob("*.py")
        modules |= {str(path.relative_to(ROOT / "workbench")) for path in paths if imported.search(path.read_text())}
    near = [test for test in tests if any(call.split(":")[0] in modules for call in test.functions)]
    files = Counter(test.file for test in near if function in test.functions) or Counter(test.file for test in near)
    stems = [Path(module).stem for module in modules]
    first = max(files, key=lambda file: (any(stem in file for stem in stems), files[file]), default="")
    groups: list[list[CalledTest]] = [[], []]
    for test in sorted(near, key=lambda test: (function not in test.functions, test.seconds)):
        group = groups[test.file != first]
        if len(group) < 2 or sum(each.seconds for each in group) + test.seconds <= SECONDS:
            group.append(test)
    return [group for group in groups if group]


def _outcome(mutant: Mutant, tests: Sequence[CalledTest]) -> tuple[Mutant, str]:
    """Return whether the tests find a mutant in this worker's tree, which is restored."""
    file = _tree / "workbench" / mutant.path
    source, times, result = file.read_bytes(), file.stat(), _NO_TEST
    file.write_bytes(source[: mutant.start] + mutant.new + source[mutant.end :])
    for group in _chosen_tests(mutant, tests):
        limit_s = 120.0 + 4.0 * sum(test.seconds for test in group)
        code = _in_child(partial(_pytest, _tree, ["-x", *(test.name for test in group)]), limit_s)
        result = _TIME_LIMIT if code is None else _SURVIVED if code == 0 else _FOUND
        if result != _SURVIVED:
            break
    file.write_bytes(source)
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    return mutant, result


_tree = ROOT  # of a worker, its copy


def _copy_tree(folder: str) -> None:
    global _tree
    _tree = Path(folder, str(os.getpid()))
    shutil.copytree(ROOT, _tree, ignore=shutil.ignore_patterns(".venv", ".git", "runs", "sweeps"), symlinks=True)


def tables(results: Sequence[tuple[Mutant, str]]) -> str:
    """Return Markdown tables of the outcomes by package, and of the mutants that were not found."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for mutant, what in results:
        counts[mutant.path.split("/")[0]][what] += 1
        counts["all"][what] += 1
    lines = [f"| package | {' | '.join(_OUTCOMES)} | found, % |", "| --- " * 6 + "|"]
    for name, count in sorted(counts.items()):
        share = 100.0 * (count[_FOUND] + count[_TIME_LIMIT]) / count.total()
        lines.append(f"| {name} | {' | '.join(str(count[each]) for each in _OUTCOMES)} | {share:.0f} |")
    lines += ["", "| survivor | code | mutated | |", "| --- " * 4 + "|"]
    for mutant, what in sorted(results):
        if what in (_SURVIVED, _NO_TEST):
            source = (ROOT / "workbench" / mutant.path).read_bytes()
            old, column = source[mutant.start : mutant.end], mutant.start - source.rfind(b"\n", 0, mutant.start)
            cells = source.splitlines()[mutant.line - 1], b"%b to %b, column %d" % (old, mutant.new, column)
            code, change = (" ".join(cell.decode().replace("|", "\\|").split()) for cell in cells)
            lines.append(f"| {mutant.path}:{mutant.line} | `{code}` | `{change}` | {what} |")
    return "\n".join(lines)


def main() -> None:
    """Sample, test, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m analysis.mutants", description=__doc__)
    parser.add_argument("--n", type=int, default=200, help="mutants (200)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (0)")
    parser.add_argument("--calls", type=Path, help="file of which test calls which function, written if missing")
    chosen = parser.parse_args()
    package = ROOT / "workbench"
    modules = [path for name in PACKAGES for path in sorted((package / name).rglob("*.py"))]
    sources = (_Module(str(path.relative_to(package)), path.read_bytes()) for path in modules)
    every = [mutant for module in sources for mutant in module.mutants()]
    sample = random.Random(chosen.seed).sample(every, chosen.n)
    for name in ("cv2", "h5py", "hydra", "hypothesis", "numba", "pandas", "rerun", "scipy.stats", "typer"):
        importlib.import_module(name)  # once for all tests
    files = [str(path.relative_to(ROOT)) for name in TESTS for path in sorted((ROOT / name).rglob("test_*.py"))]
    with (
        TemporaryDirectory(prefix="workbench-mutants-") as folder,
        multiprocessing.Pool(initializer=_copy_tree, initargs=(folder,)) as pool,
    ):
        if not (chosen.calls and chosen.calls.is_file()):
            calls = [test for each in tqdm(pool.imap(_calls_of, files), total=len(files)) for test in each]
            chosen.calls = chosen.calls or Path(folder, "calls.json")
            chosen.calls.write_text(json.dumps(calls))
        calls = [CalledTest(*test) for test in json.loads(chosen.calls.read_text())]
        run = partial(_outcome, tests=calls)
        results = []
        for each in tqdm(pool.imap_unordered(run, sample), total=len(sample)):
            print(*each, flush=True)
            results.append(each)
    print(tables(results))


if __name__ == "__main__":
    main()
