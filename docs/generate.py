"""Pages generated from the code: every option with its keys, and the components of every experiment.

`conf.py` calls `write` before every build; git ignores the generated pages.
"""

import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from pictures import of_experiment

from analysis import deviations
from workbench.detections.readers.formats import LAYOUTS
from workbench.evaluation.metrics import HEADLINE
from workbench.experiment.config.instantiate import config_keys, import_target
from workbench.experiment.config.options import GROUPS, Option, options
from workbench.experiment.config.schema import IF_CHOSEN, LITERAL
from workbench.recording.read.reader import read

BASELINES = Path(__file__).parents[1] / "recordings" / "baselines"
UNITS = {
    "_mm": "mm", "_m": "m", "_px": "px", "_deg": "°", "_hz": "Hz", "_s": "s", "_m_s2": "m/s²", "sigma_position": "m",
    "sigma_rotation": "rad", "sigma_phase": "cycles", "sigma_phase_speed": "cycles/s",
    "initial_position_std": "m", "initial_rotation_std": "rad", "sigma_angles": "rad", "damping": "1/s",
    "width": "px", "height": "px", "n_frames": "frames", "lag": "frames", "first_frame": "frame",
}  # fmt: skip
"""Units of keys, by name or suffix."""
_TRACKING_CAPTION = (
    "the posterior-mean skeleton in orange and the true one in blue in four frames, and the joint error by frame"
)


def write(folder: Path) -> None:
    """Write all generated pages and their pictures into a folder."""
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    draw_baselines(folder / "pictures")
    pages = {
        "options": options_page(), "experiment_components": experiments_page(), "deviations": deviations.page(),
        "keypoint_layouts": layouts_page(),
    }  # fmt: skip
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:  # an unchanged page is not rebuilt
            path.write_text(text, encoding="utf-8")


def draw_baselines(folder: Path) -> None:
    """Draw the baseline of every experiment that has one, unless its picture is up to date."""
    for name in options("experiment"):
        baseline, picture = BASELINES / f"{name}.rrd", folder / f"{name}.png"
        current = picture.is_file() and picture.stat().st_mtime >= baseline.stat().st_mtime
        if baseline.is_file() and not current:
            of_experiment(read(baseline), picture)


def options_page() -> str:
    """Return the page of all options: the docstring of each class, and its keys with their descriptions."""
    lines = [
        "# Options", "",
        "This page is for users who look up an option. It lists every option, chosen by `group=option`, and its keys, "
        "set by `group.key=value`, with their defaults and units. `workbench components prior.ar_offsets` prints the "
        "same in the terminal.", "",
    ]  # fmt: skip
    for group in GROUPS:
        if group_options := options(group):
            lines += [f"## {group}", ""]
            for option in group_options.values():
                lines += [*_option(option), ""]
    return "\n".join(lines)


def layouts_page() -> str:
    """Return the page of the detectors' layouts: their points in order."""
    lines = [
        "# Layouts of detected keypoints", "",
        "This page is for users of another detector. It lists the points of every layout that the workbench reads, in "
        "the order of the file, without those of face and hands at the end. `dataset.keypoint_layout=NAME` chooses one "
        "([File formats](../formats.md#detected-keypoints)).", "",
        "| layout | points | names |", "| --- | --- | --- |",
    ]  # fmt: skip
    for name, points in LAYOUTS.items():
        lines.append(f"| {name} | {len(points)} | {', '.join(point for point in points if point != '-')} |")
    return "\n".join([*lines, ""])


def _option(option: Option) -> Iterator[str]:
    yield from (f"### {option.group}={option.name}", "", f"{option.about}.", "")
    if option.target is None:
        return
    component = import_target(option.target)
    text, parameters = _without_parameters(inspect.getdoc(component) or "")
    yield from ("```text", text.replace("```", ""), "```", "")
    settings: Mapping[str, Any] = yaml.safe_load(option.text)
    if keys := config_keys(component):
        yield from ("| key | default | unit | description |", "| --- | --- | --- | --- |")
    for key, (_, default) in keys.items():
        value = settings.get(key, default)
        default_text = "*required*" if value is inspect.Parameter.empty else _code(value)
        description = _escaped(option.all_notes.get(key) or parameters.get(key, ""))
        yield f"| `{key}` | {default_text} | {_unit(key)} | {description} |"
    yield from (f"| `{key}` | | | {_escaped(note)} |" for key, note in option.notes.items() if "." in key)


def _without_parameters(docstring: str) -> tuple[str, dict[str, str]]:
    """Return a docstring without its section "Parameters", and the descriptions in that section by name."""
    text, _, rest = docstring.partition("\n\nParameters\n----------\n")
    section, _, other = rest.partition("\n\n")
    described = re.findall(r"^(\w.*?) : (.*(?:\n .*)*)", section, re.MULTILINE)
    descriptions = {name: " ".join(words.split()) for names, words in described for name in names.split(", ")}
    return f"{text}\n\n{other}".strip(), descriptions


def experiments_page() -> str:
    """Return the page of all experiments: components, values, and the metrics of the baseline."""
    lines = [
        "# Components of every experiment", "",
        "This page is for users who look up an experiment. It lists the components that differ from the defaults, and "
        "the values that the experiment sets; `group.key` is a key of the component of a group. *As published* lists "
        "the values of `paper=literal`. *Baseline* lists the metrics of a small recording, with a few small frames of "
        "generated people and few particles. It serves to detect changes and does not show the accuracy of an "
        "experiment, which [Experiments](../experiments.md) reports. Experiments that need recordings have no "
        "baseline.", "",
    ]  # fmt: skip
    for name, option in options("experiment").items():
        lines += [*_experiment(name, option), ""]
    return "\n".join(lines)


def _experiment(name: str, option: Option) -> Iterator[str]:
    values: dict[str, Any] = yaml.safe_load(option.text) or {}
    yield from (f"## {name}", "", f"{_about(option)}", "")
    components = dict(_components(values.pop("defaults", [])))
    conditional = values.pop(IF_CHOSEN, {})
    literal = conditional.pop(LITERAL, {})
    for omitted in ("assumptions", "hydra"):
        values.pop(omitted, None)
    if components:
        yield "- components: " + ", ".join(f"`{group}={option}`" for group, option in components.items())
    sections = (("values", values), ("values for a chosen component", conditional), ("as published", literal))
    for title, settings in sections:
        if flat := dict(_leaves(settings)):
            yield f"- {title}: " + ", ".join(f"{_code(f'{key}={_short(value)}')}" for key, value in flat.items())
    baseline = BASELINES / f"{name}.rrd"
    if baseline.is_file() and (metrics := read(baseline).result):
        names = [key for key in HEADLINE if key in metrics] or sorted(metrics)[:6]
        yield f"- baseline: {', '.join(f'{key} {metrics[key]:.3g}' for key in names)}"
        caption = "its first figures" if "body" not in read(baseline).properties else _TRACKING_CAPTION
        yield from ("", f"![The baseline of {name}: {caption}](pictures/{name}.png)")


def _about(option: Option) -> str:
    comments = [line.lstrip("# ") for line in option.text.splitlines()[1:]]
    head = next((k for k, line in enumerate(option.text.splitlines()[1:]) if not line.startswith("#")), 0)
    return _escaped(" ".join(comments[:head]))


def _components(defaults: list[Any]) -> Iterator[tuple[str, str]]:
    for each in defaults:
        if isinstance(each, str) and each != "_self_":
            yield "experiment", each
        elif isinstance(each, dict):
            for group, option in each.items():
                yield group.removeprefix("override ").lstrip("/"), str(option)


def _leaves(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in settings.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _unit(key: str) -> str:
    if key in UNITS:
        return UNITS[key]
    return next((unit for suffix, unit in UNITS.items() if suffix.startswith("_") and key.endswith(suffix)), "")


def _short(value: Any) -> str:
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= 60 else f"{text[:59]}…"


def _code(value: Any) -> str:
    text = _short(list(value) if isinstance(value, tuple) else value).replace("|", "\\|").replace("`", "'")
    return f"`{text}`" if text else ""


def _escaped(text: str) -> str:
    return re.sub(r"([|*<])", r"\\\1", text)
