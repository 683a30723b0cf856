"""The tutorial, the Python examples and the notebook of the documentation run, and its pages build."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.cli.main import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder in which the code of the pages runs."""
    return tmp_path_factory.mktemp("tutorial")


@pytest.fixture
def run(folder, cache, monkeypatch, capfd, trusted):
    """Return a function that runs `workbench` commands or Python code in this process and returns the output."""

    def run(language, code):
        if language == "python":
            exec(compile(code, "a page", "exec"), {})
        else:
            for line in code.replace("\\\n", " ").splitlines():
                name, *arguments = shlex.split(line, comments=True)
                assert (name, main(arguments)) == ("workbench", 0), line
        return capfd.readouterr().out

    monkeypatch.chdir(folder)
    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    return run


def blocks(page):
    """Return (language, code) of the blocks of a page, except those marked as not run."""
    text = (DOCS / page).read_text(encoding="utf-8")
    text = re.sub(r"<!-- not run:[^>]*-->\n```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"^```(sh|python)\n(.+?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_tutorial_runs_as_written(run, folder):
    outputs = [run(*block) for block in blocks("start/tutorial.md")]
    first, paper_a, branch, table, sweep = outputs[:5]
    assert re.search(r"^verdict: trustworthy", first, re.MULTILINE)
    assert re.search(r"^verdict: doubtful, because", paper_a, re.MULTILINE)
    assert re.search(r"^view it: \S*workbench view first/run\.rrd$", first, re.MULTILINE)
    assert "prior._target_: workbench.priors.ar_offsets.AROffsets → workbench.priors.smooth.Smooth" in branch
    rows = {row.split()[0]: row.split()[1:] for row in table.splitlines()}
    assert rows["first"][0] == "ar_offsets_gait"
    assert float(rows["first"][-1]) == float(rows["paper_a"][-1]) == 1.0  # tracked
    assert float(rows["paper_a"][1]) > 2.0 * float(rows["first"][1])
    assert float(rows["paper_a"][3]) < 0.6 < float(rows["first"][3])
    assert rows["smooth"][-1] == "0"
    assert float(rows["smooth"][2]) > 2.0 * float(rows["first"][2])
    assert "4 complete" in sweep
    assert (folder / "knee.png").stat().st_size > 10_000


@pytest.mark.slow
def test_the_python_examples_run(run, folder):
    if not (folder / "first").is_dir():
        pytest.skip("needs the runs of the tutorial: run the whole file")
    for page in ("python.md", "howto/read.md"):
        code = "\n".join(text for language, text in blocks(page) if language == "python")
        assert "recordings/runs/python" in run("python", code) or page != "python.md"


@pytest.mark.slow
def test_the_notebook_runs(tmp_path, cache, monkeypatch):
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    notebook = nbformat.read(DOCS / "notebook.ipynb", as_version=4)
    assert all(not cell.outputs for cell in notebook.cells if cell.cell_type == "code")  # stored without outputs
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.outputs)
    (coverage,) = cells[-2].outputs
    assert 0.0 < float(coverage.data["text/plain"]) <= 1.0


@pytest.mark.slow
def test_the_pages_build_without_warnings_and_load_nothing_from_the_network(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-W", "-q", str(DOCS), str(tmp_path / "html")]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    for page in (tmp_path / "html").rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert re.findall(r'<(?:script|img|link|iframe)[^>]+(?:src|href)="(?:https?:)?//[^"]+"', text) == [], page
    for style in (tmp_path / "html").rglob("*.css"):
        assert re.findall(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", style.read_text(encoding="utf-8")) == [], style
    pictures = sorted((DOCS / "_generated" / "pictures").glob("*.png"))
    experiments = (tmp_path / "html" / "_generated" / "experiment_components.html").read_text(encoding="utf-8")
    assert len(pictures) >= 20
    for picture in pictures:
        assert picture.stat().st_size <= 60_000
        assert picture.name in experiments
    options = (tmp_path / "html" / "_generated" / "options.html").read_text(encoding="utf-8")
    assert "prior=ar_offsets" in options
    assert "ess_threshold" in options or "sigma_phase" in options
