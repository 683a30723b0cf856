"""The report as Markdown, and as one self-contained HTML page."""

import base64
import html
from dataclasses import dataclass

from workbench.results.report.contents import Contents
from workbench.results.report.tables import Table, escaped, markdown, markup, printable, text

_STYLE = """
:root { color: #222; background: #fff; font: 16px/1.5 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; }
body { max-width: 58rem; margin: 2.5rem auto; padding: 0 1.25rem; }
h1 { font-size: 1.7rem; margin: 0 0 .5rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .3rem; }
figure { margin: 1rem 0 2rem; }
figure img { max-width: 100%; height: auto; width: 44rem; }
figcaption, .note { color: #555; font-size: .9rem; max-width: 44rem; }
table { border-collapse: collapse; font-size: .92rem; }
th, td { text-align: left; padding: .25rem 1.1rem .25rem 0; border-bottom: 1px solid #e4e4e4; overflow-wrap: anywhere; }
th { border-bottom: 2px solid #bbb; font-weight: 600; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.problems { border-left: 4px solid #d55e00; background: #fdf3ec; padding: .4rem 1rem; overflow-wrap: anywhere; }
.problems ul { margin: .3rem 0; padding-left: 1.1rem; }
details { margin-top: 2rem; }
summary { cursor: pointer; font-weight: 600; }
@media print {
  body { margin: 0; max-width: none; }
  figure, table { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
}
"""
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


@dataclass(frozen=True)
class Picture:
    """A plot as PNG. name: of its file. caption: what is to be seen, one or two sentences."""

    name: str
    title: str
    caption: str
    png: bytes


def terminal(found: Contents) -> str:
    """Write the report as plain text, without the lesser metrics."""
    parts = ["\n".join(found.summary)]
    if found.problems:
        parts.append("\n".join(("not counted or missing:", *(f"- {problem}" for problem in found.problems))))
    parts += [f"{title}\n{text(table)}" for title, table in (*found.chief, *found.divided)]
    if found.verdicts:
        parts.append(f"{found.verdicts[0]}\n{text(found.verdicts[1])}")
    if found.extremes:
        parts.append(f"{found.extremes[0]}\n{text(found.extremes[1])}")
    return "\n".join(map(printable, "\n\n".join(parts).split("\n")))


def as_markdown(title: str, found: Contents, pictures: list[Picture]) -> str:
    """Write the report with its pictures beside it."""
    parts = [f"# {escaped(title)}", escaped(" ".join(found.summary))]
    if found.problems:
        listed = "\n".join(f"- {escaped(problem)}" for problem in found.problems)
        parts.append(f"## Not counted or missing\n\n{listed}")
    parts += [
        f"## {picture.title}\n\n![{picture.title}]({picture.name}.png)\n\n{picture.caption}" for picture in pictures
    ]
    if found.verdicts:
        parts.append(f"## {_capital(escaped(found.verdicts[0]))}\n\n{markdown(found.verdicts[1])}")
    if found.extremes:
        parts.append(f"## {_capital(escaped(found.extremes[0]))}\n\n{markdown(found.extremes[1])}")
    for heading, tables in (("Metrics", found.chief), ("Divided", found.divided), ("Other metrics", found.others)):
        if tables:
            parts.append(f"## {heading}")
            parts += [f"### {escaped(name)}\n\n{markdown(table)}" for name, table in tables]
    return "\n\n".join(parts) + "\n"


def as_page(title: str, found: Contents, pictures: list[Picture]) -> str:
    """Write the report with its pictures inside. It has no scripts, and forbids itself to load anything."""
    parts = [f"<h1>{html.escape(title)}</h1>", f'<p class="note">{html.escape(" ".join(found.summary))}</p>']
    if found.problems:
        listed = "".join(f"<li>{html.escape(problem)}</li>" for problem in found.problems)
        parts.append(f'<section class="problems"><strong>Not counted or missing</strong><ul>{listed}</ul></section>')
    for picture in pictures:
        data = base64.b64encode(picture.png).decode("ascii")
        image = f'<img alt="{html.escape(picture.title)}" src="data:image/png;base64,{data}">'
        parts.append(f"<figure>{image}<figcaption>{html.escape(picture.caption)}</figcaption></figure>")
    if found.verdicts:
        parts.append(f"<h2>{html.escape(_capital(found.verdicts[0]))}</h2>\n{markup(found.verdicts[1])}")
    if found.extremes:
        parts.append(f"<h2>{html.escape(_capital(found.extremes[0]))}</h2>\n{markup(found.extremes[1])}")
    if found.chief:
        parts += ["<h2>Metrics</h2>", *(_section(*table) for table in found.chief)]
    if found.divided:
        parts += ["<h2>Divided</h2>", *(_section(*table) for table in found.divided)]
    if found.others:
        lesser = "\n".join(_section(*table) for table in found.others)
        parts.append(f"<details><summary>Other metrics</summary>\n{lesser}\n</details>")
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        f"<title>{html.escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _section(title: str, table: Table) -> str:
    return f"<h3>{html.escape(title)}</h3>\n{markup(table)}"


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
