"""Draw the packages of the workbench and their imports, from the import graph: `python docs/import_graph.py`.

The layers are those of the import contract in pyproject.toml. An arrow is drawn for an import that no longer path of
imports implies (the transitive reduction of the graph).
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "pictures" / "packages.svg"
_WIDTH, _ROW, _BOX_HEIGHT, _CHARACTER = 860, 62, 30, 8


def layers() -> list[list[str]]:
    """Return the names of the packages by layer, the highest first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layered,) = [each for each in contracts if each.get("containers") == ["workbench"]]
    return [[name.strip() for name in layer.split("|")] for layer in layered["layers"]]


def imports() -> dict[str, set[str]]:
    """Return the packages that each package imports directly."""
    graph = grimp.build_graph("workbench")
    names = [name for layer in layers() for name in layer]
    for name in names:
        if graph.find_children(f"workbench.{name}"):
            graph.squash_module(f"workbench.{name}")
    found = {name: graph.find_modules_directly_imported_by(f"workbench.{name}") for name in names}
    return {name: {module.rpartition(".")[2] for module in found[name]} & set(names) for name in names}


def reduced(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return an acyclic graph without the edges that a longer path implies."""

    def reached(name: str) -> set[str]:
        return graph[name].union(*(reached(each) for each in graph[name]))

    return {name: {to for to in direct if not any(to in reached(each) for each in direct)}
            for name, direct in graph.items()}  # fmt: skip


def picture() -> str:
    """Return the SVG: a row for each layer, and arrows from the importing to the imported package."""
    places = {
        name: (round(_WIDTH * (k + 1) / (len(layer) + 1)), _ROW * row + 30)
        for row, layer in enumerate(layers()) for k, name in enumerate(layer)
    }  # fmt: skip
    height = max(y for _, y in places.values()) + 30
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" font-family="sans-serif" '
        'font-size="14" text-anchor="middle">',
        "<title>Packages of the workbench; arrows point to what a package imports</title>",
        '<marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0L8 4L0 8z" fill="#777"/></marker>',
        f'<rect width="{_WIDTH}" height="{height}" fill="white"/>',
    ]
    half = _BOX_HEIGHT // 2
    for name, targets in reduced(imports()).items():
        x, y = places[name]
        for to_x, to_y in sorted(places[target] for target in targets):
            middle = (y + to_y) // 2
            lines.append(
                f'<path d="M{x} {y + half}C{x} {middle} {to_x} {middle} {to_x} {to_y - half}" fill="none" '
                'stroke="#777" marker-end="url(#tip)"/>'
            )
    for name, (x, y) in places.items():
        width = _CHARACTER * len(name) + 16
        lines += [
            f'<rect x="{x - width // 2}" y="{y - half}" width="{width}" height="{_BOX_HEIGHT}" rx="4" fill="#eef3fa" '
            'stroke="#46699a"/>',
            f'<text x="{x}" y="{y + 5}">{name}</text>',
        ]
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
