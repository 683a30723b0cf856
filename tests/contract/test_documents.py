"""Links, commands and paths in the documents refer to what exists, and every page is reachable."""

import re
from pathlib import Path

import pytest

from workbench.cameras import camera_formats, laboratory_formats
from workbench.cli.main import main
from workbench.datasets import point_formats
from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import GROUPS, options
from workbench.motion.formats import motion_export

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", *DOCS.rglob("*.md")])
WRITTEN = [page for page in PAGES if not {"_generated", "_tables"} & {*page.parts}]
_FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
GENERATED = ("options.md", "experiment_components.md", "deviations.md", "keypoint_layouts.md")


def prose(page):
    return _FENCE.sub("", page.read_text(encoding="utf-8"))


def commands(page):
    """Yield the workbench's command lines in shell blocks, with continued lines joined."""
    for block in re.findall(r"```sh\n(.+?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        yield from (line for line in block.replace("\\\n", " ").splitlines() if "workbench" in line)


def anchors(page):
    """Return the anchors of a page's headings as GitHub and MyST form them."""
    titles = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def target_exists(page, link):
    """Return whether a link's file exists, and its heading if the link names one."""
    target, _, anchor = link.partition("#")
    file = (page.parent / target).resolve() if target else page
    if file.parent.name == "_generated" and file.name in GENERATED:  # written when the pages are built
        return True
    if file.parent == DOCS / "_generated" / "pictures":  # drawn from the baselines when the pages are built
        return (ROOT / "recordings" / "baselines" / f"{file.stem}.rrd").is_file()
    return file.exists() and (not anchor or anchor in anchors(file))


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_has_a_target(page):
    links = re.findall(r"\]\(([^)\s]+)\)|\{download\}`[^<]*<([^>]+)>`", prose(page))
    local = [link for groups in links for link in groups if link and not link.startswith(("http:", "https:"))]
    assert [link for link in local if not target_exists(page, link)] == []
    assert all(link.startswith("https:") or link.startswith("http://mocap.cs.cmu.edu")
               for groups in links for link in groups if link.startswith("http"))  # fmt: skip


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_choose_existing_options(page):
    package = {"prior": {"still"}, "likelihood": {"upright"}, "dataset": {"nodding"}}  # of the package my_components
    folder = {"experiment": {"mine"}}  # of a folder given by --config-dir
    for line in commands(page):
        for group, chosen in re.findall(r"\b(experiment|paper|" + "|".join(GROUPS) + r")=([\w,]+)", line):
            names = set(options(group)) | (package.get(group, set()) if "my_components" in line else set())
            names |= folder.get(group, set()) if "--config-dir" in line else set()
            assert set(chosen.split(",")) <= names, line


@pytest.mark.parametrize("page", ["glossary.md", "architecture.md", "security.md"])
def test_paths_of_the_code_exist(page):
    paths = re.findall(r"`((?:workbench|conf|tests)/[\w/.]*)`", (DOCS / page).read_text(encoding="utf-8"))
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_keys_and_options_of_the_formats_exist(monkeypatch, capsys):
    text = (DOCS / "formats.md").read_text(encoding="utf-8")
    targets = [import_target(option.target) for option in options("dataset").values() if option.target]
    assert set(re.findall(r"dataset\.(\w+)", text)) <= {key for target in targets for key in config_keys(target)}
    monkeypatch.setenv("COLUMNS", "200")
    for command in ("import", "export", "track"):
        main([command, "--help"])
    assert set(re.findall(r"--[a-z][\w-]*", text)) <= set(re.findall(r"--[a-z][\w-]*", capsys.readouterr().out))


def test_every_format_is_documented():
    text = (DOCS / "formats.md").read_text(encoding="utf-8")
    suffixes = {
        *motion_export.SUFFIXES,
        *point_formats.READERS,
        *camera_formats.SUFFIXES,
        *laboratory_formats.SUFFIXES,
        ".h5",
        ".toml",
        ".mp4",
    }
    assert {suffix for suffix in suffixes if f"`{suffix}`" not in text} == set()


def test_every_page_is_reachable_from_the_index():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    assert re.search(r"^\*$", index, re.MULTILINE)  # every page in the same folder
    assert re.search(r"^howto/\*$", index, re.MULTILINE)
    for page in WRITTEN:
        if page.is_relative_to(DOCS) and page.parent not in (DOCS, DOCS / "howto"):
            assert str(page.relative_to(DOCS).with_suffix("")) in index, page


PICTURES = [path for path in sorted(DOCS.rglob("*.png")) if "_generated" not in path.parts]


@pytest.mark.parametrize("picture", PICTURES + sorted((ROOT / "analysis").rglob("*.png")), ids=str)
def test_pictures_are_small_and_shown(picture):
    assert picture.stat().st_size <= 300_000
    assert any(picture.name in prose(page) for page in WRITTEN)
