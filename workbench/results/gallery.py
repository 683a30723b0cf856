"""Runs as cards in the viewer, served to this machine alone by Rerun's own catalog (the extra `catalog`)."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tqdm import tqdm

from workbench.evaluation.headline import SHORT_TITLES
from workbench.recording.write.cards import CARD, column, has_layout, images_in, recording_id, write_card, write_layout
from workbench.recording.write.file import CHOICES, HOST, SETTINGS
from workbench.results.entry import Entry
from workbench.results.listing import varied
from workbench.results.report.tables import printable
from workbench.results.report.variation import TARGET, flat, what_varied
from workbench.utils.errors import InputError

_TEXTS = ("status", "started", "path")
_LONGEST_TITLE = 200
_PREVIEWED = 6
"""Runs in which images and a layout are looked for: about what a screen shows."""


@dataclass(frozen=True)
class Gallery:
    """Runs that are served. url: what the viewer opens. left_out: a sentence for each run that is not."""

    url: str
    n_runs: int
    left_out: tuple[str, ...]


@contextmanager
def gallery(entries: Sequence[Entry]) -> Iterator[Gallery]:
    """Serve the runs at a free port of 127.0.0.1 as long as the block lasts, in this order.

    Raises InputError without the extra `catalog`, and where none of the runs has a recording that can be read.
    """
    if find_spec("datafusion") is None:
        raise InputError(
            "--gallery needs Rerun's catalog, the extra 'catalog': in the clone "
            f"`{sys.executable} -m pip install -c requirements.lock -e '.[catalog]'` installs it"
        )
    from rerun.server import Server  # here, as it needs the extra

    ids, left_out = _distinct(entries)
    with Server(host=HOST) as server, TemporaryDirectory(prefix="workbench-runs-") as folder:
        client = server.client()
        dataset = client.create_dataset("runs")
        refused = _register(dataset, {path: Path(str(entry.recording)) for path, (entry, _) in ids.items()})
        left_out += [f"{path}: left out, as the catalog refuses it: {reason}" for path, reason in refused.items()]
        shown = [entry for path, (entry, _) in ids.items() if path not in refused]
        if not shown:
            raise InputError("; ".join(left_out))
        _add_cards(dataset, shown, [ids[entry.path][1] for entry in shown], Path(folder))
        _lay_out(dataset, shown, Path(folder) / "runs.rbl")
        yield Gallery(f"{server.url()}/entry/{dataset.id}", len(shown), tuple(left_out))


def titles(entries: Sequence[Entry]) -> list[str]:
    """Name each run by its experiment, what tells it from the others, and its seed."""
    seeds = {entry.seed for entry in entries}
    found = []
    for entry, told in zip(entries, varied(entries), strict=True):
        words = [told] * bool(told) + [f"seed={entry.seed}"] * (len(seeds) > 1)
        found.append(printable(": ".join([entry.experiment, *[", ".join(words)] * bool(words)]))[:_LONGEST_TITLE])
    return found


def _distinct(entries: Sequence[Entry]) -> tuple[dict[str, tuple[Entry, tuple[str, str]]], list[str]]:
    """The runs with a recording of an id of its own, by path, with its ids, and a sentence for each of the others."""
    kept: dict[str, tuple[Entry, tuple[str, str]]] = {}
    owners: dict[str, str] = {}
    left_out = []
    for entry in tqdm(entries, unit="run", disable=None):
        if entry.recording is None:
            left_out.append(f"{entry.path}: left out, as it has no recording ({entry.status})")
            continue
        try:
            ids = recording_id(Path(entry.recording))
        except InputError as error:
            left_out.append(f"left out: {error}")
            continue
        if (owner := owners.setdefault(ids[1], entry.path)) != entry.path:
            left_out.append(f"{entry.path}: left out, as it says that it is the same run as {owner}")
        else:
            kept[entry.path] = entry, ids
    if not kept:
        raise InputError("; ".join(left_out) or "no run fits")
    return kept, left_out


def _register(dataset: Any, files: dict[str, Path], **options: str) -> dict[str, str]:
    """Have the catalog serve these files; returns why it refuses some, by their names."""
    names = {file.resolve().as_uri(): name for name, file in files.items()}
    try:
        results = list(dataset.register(list(names), **options).iter_results())
    except (ValueError, LookupError, RuntimeError) as error:
        raise InputError(f"the catalog refuses the recordings: {' '.join(str(error).split())[:300]}") from None
    return {names[each.uri]: " ".join(each.error.split())[:300] for each in results if each.error}


def _add_cards(dataset: Any, entries: Sequence[Entry], ids: Sequence[tuple[str, str]], folder: Path) -> None:
    files = {}
    cards = zip(entries, ids, titles(entries), strict=True)
    for k, (entry, names, title) in enumerate(tqdm(cards, total=len(entries), unit="card", disable=None)):
        texts = {"title": title} | {name: printable(getattr(entry, name)) for name in _TEXTS}
        numbers = {name: float(f"{entry.metrics[name]:.4g}") for name in SHORT_TITLES if name in entry.metrics}
        card = {"rank": float(k)} | numbers | {name: text for name, text in texts.items() if text}
        files[entry.path] = folder / f"{k}.rrd"
        write_card(files[entry.path], names, card, entry.settings, entry.choices)
    if refused := _register(dataset, files, layer_name=CARD):
        path, reason = next(iter(refused.items()))
        raise InputError(f"{path}: the catalog refuses its card: {reason}")


def _lay_out(dataset: Any, entries: Sequence[Entry], file: Path) -> None:
    """Title, picture and numbers on cards; in rows, columns of what varied beside them.

    Where not all runs have the same image, the error's curve stands beside it.

    A run that is opened is laid out as it says where all are of one experiment, as a dataset has one layout for all.
    """
    first = entries[:_PREVIEWED]
    known = set(dataset.segment_table().schema().names)
    titles = SHORT_TITLES | dict(zip(_TEXTS, _TEXTS, strict=True))
    fields = {column(CARD, name): title for name, title in titles.items()}
    fields = {source: label for source, label in fields.items() if source in known}
    keys = what_varied([flat(entry.settings, entry.experiment) for entry in entries]).keys
    varying = [column(name, key.removesuffix(TARGET)) for key in keys for name in (SETTINGS, CHOICES)]
    columns = [*(source for source in varying if source in known), *fields]
    found = Counter(path for entry in first for path in images_in(Path(str(entry.recording)))[:1])
    images = [path for path, _ in found.most_common(1)]
    curve = not images or found[images[0]] < len(first)
    write_layout(file, column(CARD, "title"), fields, columns, column(CARD, "rank"), images, curve)
    dataset.register_blueprint(file.resolve().as_uri(), segment_table=True)
    laid_out = (Path(str(entry.recording)) for entry in first if has_layout(Path(str(entry.recording))))
    if len({entry.experiment for entry in entries}) == 1 and (own := next(laid_out, None)) is not None:
        dataset.register_blueprint(own.resolve().as_uri())
