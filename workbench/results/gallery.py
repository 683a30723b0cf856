"""Gallery of runs as cards in the viewer, served locally by Rerun's catalog (the extra `catalog`)."""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import pandas as pd
from tqdm import tqdm

from workbench.evaluation.metrics import SHORT_TITLES
from workbench.recording.read.chunks import recording_of
from workbench.recording.write.cards import CARD, column, preview_of, write_card, write_layout
from workbench.recording.write.file import CHOICES, HOST, SETTINGS
from workbench.results.query import varied
from workbench.results.report.variation import TARGET, flat, what_varied
from workbench.results.table import records_of
from workbench.utils.errors import InputError
from workbench.utils.text import printable

_TEXTS = ("status", "started", "path")
_LONGEST_TITLE = 200
_N_PREVIEWED = 6
"""Runs that are searched for images and a layout: about as many as a screen shows."""

_Card = tuple[str, dict[str, Any], tuple[str, str]]
"""Title, record, and ids of the application and the recording."""


class _Gallery(NamedTuple):
    """Served runs. url: address for the viewer. left_out: a message for each run that is not served."""

    url: str
    n_runs: int
    left_out: list[str]


@contextmanager
def gallery(runs: pd.DataFrame) -> Iterator[_Gallery]:
    """Serve the runs of `read_runs` in order, at a free port of 127.0.0.1, until the block ends.

    Raises InputError without the extra `catalog`, and where no run has a readable recording.
    """
    if find_spec("datafusion") is None:
        raise InputError(
            "the gallery needs Rerun's catalog, the extra 'catalog': in the clone "
            f"`{sys.executable} -m pip install -c requirements.lock -e '.[catalog]'` installs it"
        )
    from rerun.server import Server  # here, since it needs the extra

    cards, left_out = _cards(runs)
    with Server(host=HOST) as server, TemporaryDirectory(prefix="workbench-") as folder:
        dataset = server.client().create_dataset("runs")
        refused = _register(dataset, {record["path"]: Path(record["recording"]) for _, record, _ in cards})
        left_out += [f"left out: {path}: the catalog refuses it: {reason}" for path, reason in refused.items()]
        cards = [card for card in cards if card[1]["path"] not in refused]
        if not cards:
            raise InputError("; ".join(left_out) or "no run matches")
        _add_cards(dataset, cards, Path(folder))
        _lay_out(dataset, [record for _, record, _ in cards], Path(folder) / "runs.rbl")
        yield _Gallery(f"{server.url()}/entry/{dataset.id}", len(cards), left_out)


def titles(runs: pd.DataFrame) -> list[str]:
    """Return titles of runs: the experiment, the differences of the configuration from the others', and the seed."""
    names = []
    for experiment, words, seed in zip(runs["experiment"], varied(runs), runs["seed"], strict=True):
        more = [words] * bool(words) + [f"seed={seed}"] * (runs["seed"].nunique() > 1)
        names.append(printable(f"{experiment}: {', '.join(more)}" if more else experiment)[:_LONGEST_TITLE])
    return names


def _cards(runs: pd.DataFrame) -> tuple[list[_Card], list[str]]:
    """Return the runs whose recordings have unique ids, and a message for each of the others."""
    cards: dict[str, _Card] = {}
    left_out = []
    for title, record in tqdm(list(zip(titles(runs), records_of(runs), strict=True)), unit="run", disable=None):
        try:
            if record["recording"] is None:
                raise InputError(f"{record['path']}: it has no recording ({record['status']})")
            ids = recording_of(Path(record["recording"]))
            if ids[1] in cards:
                raise InputError(f"{record['path']}: it has the same id as {cards[ids[1]][1]['path']}")
            cards[ids[1]] = title, record, ids
        except InputError as error:
            left_out.append(f"left out: {error}")
    return list(cards.values()), left_out


def _register(dataset: Any, files: Mapping[str, Path], **options: str) -> dict[str, str]:
    """Register files in the catalog, and return its reasons for refused ones by name."""
    names = {file.resolve().as_uri(): name for name, file in files.items()}
    try:
        results = list(dataset.register(list(names), **options).iter_results()) if names else []
    except (ValueError, LookupError, RuntimeError) as error:
        raise InputError(f"the catalog refuses the recordings: {' '.join(str(error).split())[:300]}") from None
    return {names[each.uri]: " ".join(each.error.split())[:300] for each in results if each.error}


def _add_cards(dataset: Any, cards: Sequence[_Card], folder: Path) -> None:
    files = {}
    for k, (title, record, ids) in enumerate(tqdm(cards, unit="card", disable=None)):
        texts = {"title": title} | {name: printable(record[name]) for name in _TEXTS}
        metrics = record["metrics"]
        numbers = {name: float(f"{metrics[name]:.4g}") for name in SHORT_TITLES if name in metrics}
        card = {"rank": float(k)} | numbers | {name: text for name, text in texts.items() if text}
        files[record["path"]] = folder / f"{k}.rrd"
        write_card(files[record["path"]], ids, card, record["settings"], record["choices"])
    if refused := _register(dataset, files, layer_name=CARD):
        path, reason = next(iter(refused.items()))
        raise InputError(f"{path}: the catalog refuses its card: {reason}")


def _lay_out(dataset: Any, records: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Register layouts: of cards with title, picture and metrics, and of rows with columns of varying keys.

    The error's curve is shown where not all runs have the same image. An opened run has its own layout where all runs
    are of one experiment, since a dataset has one layout.
    """
    available = set(dataset.segment_table().schema().names)
    names = SHORT_TITLES | {name: name for name in _TEXTS}
    fields = {column(CARD, name): title for name, title in names.items() if column(CARD, name) in available}
    keys = what_varied([flat(record["settings"], record["experiment"]) for record in records]).keys
    varying = [column(name, key.removesuffix(TARGET)) for key in keys for name in (SETTINGS, CHOICES)]
    columns = [*(source for source in varying if source in available), *fields]
    previews = {Path(record["recording"]): preview_of(Path(record["recording"])) for record in records[:_N_PREVIEWED]}
    first_images = Counter(path for paths, _ in previews.values() for path in paths[:1])
    images = [path for path, _ in first_images.most_common(1)]
    curve = not images or first_images[images[0]] < len(previews)
    write_layout(file, column(CARD, "title"), fields, columns, column(CARD, "rank"), images, curve)
    dataset.register_blueprint(file.resolve().as_uri(), segment_table=True)
    layout_of = next((recording for recording, (_, has_layout) in previews.items() if has_layout), None)
    if layout_of is not None and len({record["experiment"] for record in records}) == 1:
        dataset.register_blueprint(layout_of.resolve().as_uri())
