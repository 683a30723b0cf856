"""Cards of a gallery, one file for each recording, and their layout."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import rerun.blueprint as rrb
from rerun.blueprint import table
from rerun.chunk import RrdReader

from workbench.recording.settings import numbers_and_texts
from workbench.recording.write.file import CHOICES, SETTINGS, arrow, written_file

CARD = "card"
"""The property that a card adds to a recording."""
_OPEN = "recording link"
"""The viewer's column with the recording that a card opens and previews."""
_IMAGES = ("EncodedImage:blob", "VideoFrameReference:timestamp")
_SCENE = "/world/"
_CURVE = "/metrics/mpjpe_abs_mm"


def preview_of(path: Path) -> tuple[list[str], bool]:
    """Return the paths of the cameras' images in a recording, sorted, and whether it has a layout of its own.

    Plots of marginals are excluded. An incomplete recording has neither images nor a layout.
    """
    try:
        reader = RrdReader(path)
        columns, has_layout = reader.store().schema().component_columns(), bool(reader.blueprints())
    except (RuntimeError, ValueError, OSError):
        return [], False
    images = {each.entity_path for each in columns if each.component in _IMAGES}
    return sorted(path for path in images if path.startswith(_SCENE)), has_layout


def write_card(
    path: Path, ids: tuple[str, str], card: Mapping[str, Any], settings: Mapping[str, Any], choices: Mapping[str, str]
) -> None:
    """Write an .rrd that adds a card, and the configuration key by key, to a recording.

    Parameters
    ----------
    path : of the .rrd.
    ids : of the recording's application and of the recording.
    card : strings and numbers by name.
    settings, choices : see `numbers_and_texts`.
    """
    numbers, texts = numbers_and_texts(settings, choices)
    with written_file(path, *ids, send_properties=False) as stream:
        for name, values in ((CARD, card), (SETTINGS, numbers), (CHOICES, texts)):
            if values:
                stream.send_property(name, arrow(values))


def column(name: str, key: str) -> str:
    """Return the column of a property's key in a catalog's dataset."""
    return f"property:{name}:{re.sub('[.-]', '_', key)}"


def write_layout(
    path: Path, title: str, fields: Mapping[str, str], columns: Sequence[str], sort_by: str, images: Sequence[str],
    curve: bool,
) -> None:  # fmt: skip
    """Write the layout, an .rbl, of a table of recordings that opens as cards and can be switched to rows.

    Parameters
    ----------
    path : of the .rbl.
    title : column with a card's title.
    fields : columns below the title of a card, and their names.
    columns : first columns of rows.
    sort_by : a column, smallest first.
    images : entities that a card shows side by side, where its recording has them.
    curve : show the error's curve.
    """
    hidden = rrb.PlotLegend(visible=False)
    views: list[rrb.View] = [rrb.Spatial2DView(origin=image, contents=["$origin/**"]) for image in images]
    if curve:
        views.append(rrb.TimeSeriesView(origin="/metrics", contents=[_CURVE], plot_legend=hidden))
    preview = table.Column(_OPEN, name="open", column_type=table.PreviewCell(*views))
    named = [table.Column(source, name=name) for source, name in fields.items()]
    rows = [table.Column(source, name=fields.get(source)) for source in (_OPEN, title, *columns)]
    table.TableBlueprint(
        card_layout=table.CardLayout(title=title, link=_OPEN, fields=[preview, *named]),
        table_layout=table.TableLayout(columns=rows),
        previews_config=table.PreviewsConfig(timeline="frame"),
        sort_by=sort_by,
    ).save("workbench_cards", path)
