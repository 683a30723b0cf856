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
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if "_generated" not in page.parts),
]
TEXT = {
    *("told", "tell", "tells", "telling", "whoever", "nobody", "somebody", "anybody", "beside", "anew", "lent", "leap"),
    *("leapt", "leaps", "doubt", "stranger", "strangers", "departures", "lacking", "mendable", "judged"),
}
"""Words that no identifier, docstring or comment contains."""
NAMES = TEXT | {"apart", "kept", "missed", "whose"}
"""Words that no identifier contains."""


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


def retired(path: Path) -> set[str]:
    """Return the retired words in the text and in the names of a Python file."""
    source = path.read_text(encoding="utf-8")
    if NAMES.isdisjoint(words(f"{path.stem} {source}")):
        return set()  # most files: parsing is slow
    tree = ast.parse(source)
    names = {name for name in {*identifiers(tree), path.stem} if NAMES.intersection(words(name))}
    return names | {word for text in texts(source, tree) for word in re.findall("[a-z]+", text.lower())} & TEXT


@pytest.mark.parametrize("folder", [PACKAGE, ROOT / "tests"], ids=lambda path: path.name)
def test_python_files_have_no_retired_word(folder):
    files = [path for path in folder.rglob("*.py") if "conf" not in path.relative_to(folder).parts]
    assert len(files) > 100
    by_file = {str(path.relative_to(folder)): retired(path) for path in files if path != Path(__file__)}
    assert {path: file_words for path, file_words in by_file.items() if file_words} == {}


def test_pages_have_no_retired_word():
    by_page = {page.name: set(re.findall("[a-z]+", page.read_text(encoding="utf-8").lower())) & TEXT for page in PAGES}
    assert {name: page_words for name, page_words in by_page.items() if page_words} == {}


def test_a_retired_word_is_detected_in_a_name_a_docstring_and_a_comment(tmp_path):
    file = tmp_path / "example.py"
    file.write_text('def is_told(kept_rows):\n    """Tell it."""\n    n = 1  # whoever asks\n')
    assert retired(file) == {"is_told", "kept_rows", "tell", "whoever"}
