"""The pages that follow from the code: every option with its keys, and what every experiment is made of.

`conf.py` calls `write` before every build, so that none of it is written by hand or kept in git.
"""

import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from pictures import of_experiment

from workbench.experiment.config.instantiate import keys_of, resolved
from workbench.experiment.config.options import GROUPS, Option, options
from workbench.experiment.config.schema import LITERAL, WHEN
from workbench.recording.read.reader import read

BASELINES = Path(__file__).parents[1] / "recordings" / "baselines"
SHOWN = ("error_abs_mm", "error_rel_mm", "error_px", "knee_deg", "coverage_90", "held")
UNITS = {
    "_mm": "mm", "_m": "m", "_px": "px", "_deg": "°", "_hz": "Hz", "_s": "s", "_m_s2": "m/s²", "sigma_position": "m",
    "sigma_rotation": "rad", "sigma_phase": "cycles", "sigma_phase_speed": "cycles/s",
    "start_position": "m", "start_rotation": "rad", "sigma_angles": "rad", "damping": "1/s",
    "width": "px", "height": "px", "n_frames": "frames", "lag": "frames", "first_frame": "frame",
}  # fmt: skip
"""Units of keys, by the name or how it ends; where a note says one, that stands."""
_SEEN = "the skeleton, expected in orange and true in blue, in four frames, and the error of the joints by frame"


def write(folder: Path) -> None:
    """Write all pages into a folder."""
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    draw_baselines(folder / "pictures")
    pages = {"options": options_page(), "parts_of_experiments": experiments_page()}
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:  # else it would be built again
            path.write_text(text, encoding="utf-8")


def draw_baselines(folder: Path) -> None:
    """Draw the baseline of every experiment that has one, where it is not drawn yet as it is now."""
    for name in options("experiment"):
        baseline, picture = BASELINES / f"{name}.rrd", folder / f"{name}.png"
        current = picture.is_file() and picture.stat().st_mtime >= baseline.stat().st_mtime
        if baseline.is_file() and not current:
            of_experiment(read(baseline), picture)


def options_page() -> str:
    """Every option of every group: what its class says of itself, and its keys."""
    lines = [
        "# Options", "",
        "What can be chosen as `group=option`, and the keys that can be set as `group.key=value`, with their defaults. "
        "`workbench components prior.jitter` says the same in the terminal.", "",
    ]  # fmt: skip
    for group in GROUPS:
        if found := options(group):
            lines += [f"## {group}", ""]
            for option in found.values():
                lines += [*_option(option), ""]
    return "\n".join(lines)


def _option(option: Option) -> Iterator[str]:
    yield from (f"### {option.group}={option.name}", "", f"{option.about}.", "")
    if option.target is None:
        return
    part = resolved(option.target)
    yield from ("```text", inspect.cleandoc(inspect.getdoc(part) or "").replace("```", ""), "```", "")
    own: Mapping[str, Any] = yaml.safe_load(option.text)
    if keys := keys_of(part):
        yield from ("| key | default | unit | |", "| --- | --- | --- | --- |")
    for key, (_, default) in keys.items():
        value = own.get(key, default)
        shown = "none: say it" if value is inspect.Parameter.empty else _code(value)
        yield f"| `{key}` | {shown} | {_unit(key)} | {_escaped(option.notes.get(key, ''))} |"


def experiments_page() -> str:
    """What every experiment is made of and sets, and the numbers of its baseline."""
    lines = [
        "# Parts of every experiment", "",
        "What an experiment chooses where the usual part is not taken, and what it sets; a key with a dot is of the "
        "part before it. *As its paper writes it* is what `paper=literal` sets instead. *Baseline* are the numbers of "
        "the small recording that is kept to notice changes: a few frames of small images and few particles, of "
        "generated people; they say nothing of how well an experiment does, which [Experiments](../experiments.md) "
        "does. Experiments that need recordings have none.", "",
    ]  # fmt: skip
    for name, option in options("experiment").items():
        lines += [*_experiment(name, option), ""]
    return "\n".join(lines)


def _experiment(name: str, option: Option) -> Iterator[str]:
    own: dict[str, Any] = yaml.safe_load(option.text) or {}
    yield from (f"## {name}", "", f"{_about(option)}", "")
    chosen = dict(_chosen(own.pop("defaults", [])))
    when = own.pop(WHEN, {})
    literal = when.pop(LITERAL, {})
    for skipped in ("given", "hydra"):
        own.pop(skipped, None)
    if chosen:
        yield "- takes " + ", ".join(f"`{group}={option}`" for group, option in chosen.items())
    for title, settings in (("sets", own), ("with a part", when), ("as its paper writes it", literal)):
        if flat := dict(_leaves(settings)):
            yield f"- {title}: " + ", ".join(f"{_code(f'{key}={_short(value)}')}" for key, value in flat.items())
    baseline = BASELINES / f"{name}.rrd"
    if baseline.is_file() and (numbers := read(baseline).result):
        shown = [f"{key} {numbers[key]:.3g}" for key in SHOWN if key in numbers]
        shown = shown or [f"{key} {numbers[key]:.3g}" for key in sorted(numbers)[:6]]
        yield f"- baseline: {', '.join(shown)}"
        what = "its first figures" if "body" not in read(baseline).properties else _SEEN
        yield from ("", f"![The baseline of {name}: {what}](pictures/{name}.png)")


def _about(option: Option) -> str:
    comments = [line.lstrip("# ") for line in option.text.splitlines()[1:]]
    head = next((k for k, line in enumerate(option.text.splitlines()[1:]) if not line.startswith("#")), 0)
    return _escaped(" ".join(comments[:head]))


def _chosen(defaults: list[Any]) -> Iterator[tuple[str, str]]:
    for each in defaults:
        if isinstance(each, str) and each != "_self_":
            yield "experiment", each
        elif isinstance(each, dict):
            for group, option in each.items():
                yield group.removeprefix("override ").lstrip("/"), str(option)


def _leaves(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in settings.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _unit(key: str) -> str:
    if key in UNITS:
        return UNITS[key]
    return next((unit for end, unit in UNITS.items() if end.startswith("_") and key.endswith(end)), "")


def _short(value: Any) -> str:
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= 60 else f"{text[:59]}…"


def _code(value: Any) -> str:
    text = _short(list(value) if isinstance(value, tuple) else value).replace("|", "\\|").replace("`", "'")
    return f"`{text}`" if text else ""


def _escaped(text: str) -> str:
    return re.sub(r"([|*<])", r"\\\1", text)
