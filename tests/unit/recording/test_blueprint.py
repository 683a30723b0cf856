"""What a recording's layout shows first: errors, then certainty, then the posterior, and no empty panels."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from layouts import SHOWN, laid_out
from recording_steps import BODY, CAMERA, SPACE, steps
from rerun.chunk import RrdReader

from workbench.recording.write import layout, styles
from workbench.recording.write.images import picture
from workbench.recording.write.posterior import DEGREES
from workbench.recording.write.recorder import Recorder


def contents_of(shown):
    """{names of metrics: view} of the panels that show metrics, in order."""
    panels = {}
    for view in laid_out(shown).values():
        shown_in = view.contents if isinstance(view.contents, list) else [str(view.origin)]
        if metrics := tuple(path.removeprefix("/metrics/") for path in shown_in if path.startswith("/metrics/")):
            panels[metrics] = view
    return panels


def test_errors_come_first_then_certainty_then_the_posterior():
    origins = [str(view.contents) + str(view.origin) for view in laid_out(SHOWN).values()]
    shown = ["error_abs_mm", "error_px", "metrics/ess", "coverage_90", "left_knee_flexion"]
    places = [next(k for k, text in enumerate(origins) if name in text) for name in shown]
    assert places == sorted(places)


def test_every_metric_has_its_place_with_what_it_is_compared_to():
    panels = [*contents_of(SHOWN)]
    assert ("error_px", "error_px_map", "forearm_px") in panels
    assert ("error_abs_mm", "error_abs_mm_map", "error_rel_mm") in panels
    assert ("log_evidence",) in panels
    guides = [view.contents for view in laid_out(SHOWN).values() if "/metrics/coverage_90" in view.contents]
    assert guides == [["/metrics/coverage_90", "/guides/coverage_90"]]


def test_what_there_is_not_has_no_panel():
    blind = replace(SHOWN, metrics=("ess",))
    assert [*contents_of(blind)] == [("ess",)]
    assert {*laid_out(replace(blind, warned=True))} - {*laid_out(blind)} == {"warnings"}
    cameras = [picture(replace(CAMERA, name=name)) for name in ("a", "b", "c", "d")]
    assert {"a", "b", "c", "d"} <= set(laid_out(replace(SHOWN, cameras=cameras)))
    paths = ("residual_px/a", "residual_px/forearm")
    (view,) = [view for view in laid_out(replace(blind, residuals=paths)).values() if "/residual_px/a" in view.contents]
    assert view.contents == [f"/{path}" for path in paths]
    assert laid_out(replace(SHOWN, residuals=paths)).keys() == laid_out(SHOWN).keys()  # the truth says more


def test_angles_are_drawn_in_degrees():
    origins = {view.origin for view in laid_out(SHOWN).values() if "left_knee_flexion" in str(view.origin)}
    assert origins
    assert origins <= {f"/{DEGREES}/left_knee_flexion", "/posterior/pictures/left_knee_flexion"}


def test_a_metric_of_few_frames_is_marks_and_a_threshold_stays_a_line():
    panels = contents_of(replace(SHOWN, sparse=frozenset({"error_px", "forearm_px"})))
    overrides = panels["error_px", "error_px_map", "forearm_px"].visualizer_overrides
    assert list(overrides) == ["/metrics/error_px"]
    assert isinstance(overrides["/metrics/error_px"], rr.SeriesPoints)


def test_legends_find_room_above_the_curves():
    names = ("error_abs_mm", "error_abs_mm_map", "error_rel_mm")
    spans = {f"metrics/{name}": (10.0, 20.0 + k) for k, name in enumerate(names)}
    view = contents_of(replace(SHOWN, spans=spans))[names]
    (low, high), rows = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()[0], len(names)
    assert low < 10.0
    assert (high - 22.0) / (high - low) * layout.CURVES_HEIGHT > rows * layout.ROW
    assert "ScalarAxis" not in contents_of(SHOWN)[names].properties


def brightness(colour):
    """A colour's relative luminance, after WCAG 2."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (each / 255.0 for each in colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def test_lines_are_seen_on_black_and_on_white():
    lines = [styles.ESTIMATE, styles.TRUTH, styles.MODEL, styles.BAND, styles.HEAVIEST_PARTICLE, *styles.SERIES,
             *styles.PARTS, styles.LIGHTEST_PARTICLE, styles.TRAIL]  # fmt: skip
    for colour in lines:
        light = brightness(colour)
        assert min((light + 0.05) / 0.05, 1.05 / (light + 0.05)) > 1.9, colour


def record(path, run, errors):
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in run:
            recorder.log(replace(step, warnings=()), errors(step))
    return path


def static_colours(path):
    """{entity: colour} of the curves, as bytes r, g, b."""
    found = {}
    for chunk in RrdReader(path).stream().filter(is_static=True):
        batch = chunk.to_record_batch()
        if "SeriesLines:colors" in batch.schema.names:
            packed = batch.column("SeriesLines:colors").to_pylist()[0][0]
            found[chunk.entity_path] = tuple(packed.to_bytes(4, "big")[:3])
    return found


@pytest.mark.parametrize(("first_known", "n_layouts"), [(10, 1), (12, 1), (13, 2)])
def test_an_error_that_is_known_later_joins_the_layout(first_known, n_layouts, tmp_path):
    """The first three frames are written together. The estimate and its errors have one colour, the truth another."""

    def errors(step):
        return {"error_px": 3.0} if step.frame.index >= first_known else {}

    path = record(tmp_path / "run.rrd", steps(4, n_particles=20), errors)
    assert len(RrdReader(path).blueprints()) == n_layouts
    found, band = static_colours(path), "/posterior/parameters/left_knee_flexion"
    assert found[f"{band}/truth"] == tuple(styles.TRUTH)
    estimates = {found[each] for each in (f"{band}/mean", "/metrics/error_px", "/metrics/ess")}
    assert estimates == {tuple(styles.ESTIMATE)}
