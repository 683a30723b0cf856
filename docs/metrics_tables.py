"""Update the tables of all metrics in recording.md: `python docs/metrics_tables.py`."""

from pathlib import Path

from workbench.evaluation.metrics import METRICS, SECTIONS

PAGE = Path(__file__).parent / "recording.md"


def with_tables(page: str) -> str:
    """Return the page with the table of each section of metrics as `workbench/evaluation/metrics.py` has it."""
    for section in SECTIONS:
        before, heading, after = page.partition(f"### {section}\n")
        introduction, _, table_and_rest = after.partition("| metric |")
        rest = table_and_rest.partition("\n\n")[2]
        page = f"{before}{heading}{introduction}{table(section)}" + (f"\n{rest}" if rest else "")
    return page


def table(section: str) -> str:
    """Return the table of the metrics of a section."""
    lines = ["| metric | title | unit | better | definition |", "| --- | --- | --- | --- | --- |"]
    for row in METRICS:
        if row.section == section:
            names = ", ".join(f"`{name}`" for name in dict.fromkeys((row.name, *row.run_names)))
            lines.append(f"| {names} | {row.title} | {row.unit or '–'} | {row.better or '–'} | {row.meaning} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
