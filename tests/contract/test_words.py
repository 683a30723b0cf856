"""Names and text use the field's words, not the retired ones."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

import workbench

PACKAGE = Path(workbench.__file__).parent
ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / ".docs").rglob("*.md")) if "_generated" not in page.parts),
]
TEXT = {
    *("told", "tell", "tells", "telling", "whoever", "nobody", "somebody", "anybody", "beside", "anew", "lent", "leap"),
    *("leapt", "leaps", "doubt", "stranger", "strangers", "departures", "lacking", "mendable", "judged"),
}
"""Words that stand in no identifier, docstring or comment."""
NAMES = TEXT | {"apart", "kept", "missed", "whose"}
"""Words that stand in no identifier."""


def words(name: str) -> list[str]:
    """Return the words of a name in snake_case or CamelCase."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def identifiers(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def texts(source: str, tree: ast.AST) -> Iterator[str]:
    """Yield docstrings and comments."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_retired_word(path):
    if "conf" in path.relative_to(PACKAGE).parts:
        pytest.skip("a link to the configurations")
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    names = {name for name in {*identifiers(tree), path.stem} if NAMES.intersection(words(name))}
    prose = {word for text in texts(source, tree) for word in re.findall("[a-z]+", text.lower())} & TEXT
    assert (names, prose) == (set(), set())


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_no_retired_word_in_a_page(page):
    assert set(re.findall("[a-z]+", page.read_text(encoding="utf-8").lower())) & TEXT == set()


def test_a_retired_word_is_found_in_a_name_and_in_a_docstring():
    source = 'def is_told(kept_rows):\n    """Tell it."""\n    n = 1  # whoever asks\n'
    tree = ast.parse(source)
    assert {name for name in identifiers(tree) if NAMES.intersection(words(name))} == {"is_told", "kept_rows"}
    assert set(re.findall("[a-z]+", " ".join(texts(source, tree)).lower())) & TEXT == {"tell", "whoever"}
