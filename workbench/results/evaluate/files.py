"""Files of an evaluation: tables as CSV, Markdown and LaTeX."""

from pathlib import Path

import numpy as np
import pandas as pd

from workbench.evaluation.comparison.scores import SCORES
from workbench.utils.atomic_write import write_files

SCORE_FILE, JOINTS, ANGLES, MARKDOWN, LATEX = "scores.csv", "joints.csv", "angles.csv", "scores.md", "scores.tex"
_DIGITS = 6


def display(scores: pd.DataFrame) -> pd.DataFrame:
    """Return the scores with a row for each, and a column for each estimate and difference, with intervals."""
    rows = {}
    for score, each in scores.groupby("score", sort=False):
        _, unit, decimals = SCORES[str(score)]
        title = f"{each['title'].iloc[0]} ({unit})"
        rows[title] = {
            row.estimate: _text(row.value, row.low_90, row.high_90, decimals) for row in each.itertuples(index=False)
        }
    columns = list(dict.fromkeys(scores["estimate"]))
    table = pd.DataFrame.from_dict(rows, orient="index").reindex(columns=columns).fillna("–")
    return table.rename_axis("score").reset_index().astype(object)


def _text(value: float, low: float, high: float, decimals: int) -> str:
    value, low, high = (round(each, decimals) + 0.0 for each in (value, low, high))  # no −0
    words = f"{value:.{decimals}f}"
    return words if not np.isfinite(low) else f"{words} [{low:.{decimals}f}, {high:.{decimals}f}]"


def write_tables(folder: Path, scores: pd.DataFrame, joints: pd.DataFrame, angles: pd.DataFrame) -> list[Path]:
    """Write the tables into a folder, see `write_files`."""
    shown = display(scores)
    rows = [list(map(str, shown.columns)), ["---"] * len(shown.columns), *shown.astype(str).to_numpy().tolist()]
    texts = {
        SCORE_FILE: scores.round(_DIGITS).to_csv(index=False), JOINTS: joints.round(_DIGITS).to_csv(index=False),
        ANGLES: angles.round(_DIGITS).to_csv(index=False),
        MARKDOWN: "".join(f"| {' | '.join(row)} |\n" for row in rows),
        LATEX: shown.to_latex(index=False, escape=True),
    }  # fmt: skip
    return write_files(folder, texts)
