"""What a recording's layout shows first: how wrong the estimate is, how sure, and no empty panels."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from layouts import SHOWN, laid_out
from recording_steps import BODY, CAMERA, SPACE, steps
from rerun.chunk import RrdReader

from workbench.recording.write import blueprint, colours
from workbench.recording.write.images import picture
from workbench.recording.write.posterior import DEGREES
from workbench.recording.write.recorder import Recorder


def test_errors_come_first_then_certainty_then_the_posterior():
    names = list(laid_out(SHOWN))
    expected = [
        "distance from the true joints (mm)", "distance in the image (pixels)", "effective sample size (of 500)",
        "truth inside the 5–95 % bands (0.9 is right)", "left knee flexion (degrees)",
    ]  # fmt: skip
    assert [name for name in names if name in expected] == expected


def test_every_metric_has_its_place_and_the_pixels_their_yardstick():
    found = laid_out(SHOWN)
    assert found["distance in the image (pixels)"].contents == [
        f"/metrics/{name}" for name in ("error_px", "error_px_map", "forearm_px")
    ]
    assert found["distance from the true joints (mm)"].contents == [
        f"/metrics/{name}" for name in ("error_abs_mm", "error_abs_mm_map", "error_rel_mm")
    ]
    assert found["log evidence of all frames so far"].origin == "/metrics/log_evidence"


def test_what_there_is_not_has_no_panel():
    blind = replace(SHOWN, metrics=("ess",))
    names = list(laid_out(blind))
    assert not [name for name in names if "true" in name or "truth" in name or "warnings" in name]
    assert "warnings" in laid_out(replace(blind, warned=True))


def test_titles_say_what_is_drawn_and_nothing_else():
    seen = replace(SHOWN, drawn=frozenset({"particles", "marks"}))
    assert "world: estimate orange, particles purple" in laid_out(seen)
    cameras = [picture(replace(CAMERA, name=name)) for name in ("a", "b", "c", "d")]
    one, four = (laid_out(replace(seen, cameras=cameras[:n])) for n in (1, 4))
    assert "image: estimate orange, marks blue, particles purple" in one
    assert {"a", "b", "c", "d", "world: estimate orange, particles purple; in the images marks blue"} <= set(four)
    assert not [name for name in four if "truth blue" in name]


def test_angles_are_drawn_in_degrees_and_what_coverage_should_be_beside_it():
    found = laid_out(SHOWN)
    origins = {view.origin for name, view in found.items() if name == "left knee flexion (degrees)"}
    assert origins <= {f"/{DEGREES}/left_knee_flexion", "/posterior/pictures/left_knee_flexion"}
    assert not [name for name in found if "rad)" in name]
    coverage = found["truth inside the 5–95 % bands (0.9 is right)"]
    assert coverage.contents == ["/metrics/coverage_90", "/guides/coverage_90"]


def test_a_metric_of_few_frames_is_marks_and_a_threshold_stays_a_line():
    found = laid_out(replace(SHOWN, sparse=frozenset({"error_px", "forearm_px"})))
    overrides = found["distance in the image (pixels)"].visualizer_overrides
    assert list(overrides) == ["/metrics/error_px"]
    assert isinstance(overrides["/metrics/error_px"], rr.SeriesPoints)


def test_legends_find_room_above_the_curves():
    names = ("error_abs_mm", "error_abs_mm_map", "error_rel_mm")
    spans = {f"metrics/{name}": (10.0, 20.0 + k) for k, name in enumerate(names)}
    view = laid_out(replace(SHOWN, spans=spans))["distance from the true joints (mm)"]
    (low, high), rows = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()[0], len(names)
    assert low < 10.0
    assert (high - 22.0) / (high - low) * blueprint.CURVES_HEIGHT > rows * blueprint.ROW
    assert "ScalarAxis" not in laid_out(SHOWN)["distance from the true joints (mm)"].properties


def test_where_there_is_no_truth_the_cameras_residuals_are_shown():
    paths = ("residual_px/a", "residual_px/forearm")
    title = "joints from each camera's keypoints (pixels)"
    assert laid_out(replace(SHOWN, metrics=("ess",), residuals=paths))[title].contents == [f"/{each}" for each in paths]
    assert title not in laid_out(replace(SHOWN, residuals=paths))


def brightness(colour):
    """A colour's relative luminance, after WCAG 2."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (each / 255.0 for each in colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def test_lines_are_seen_on_black_and_on_white():
    lines = [colours.ESTIMATE, colours.TRUTH, colours.MODEL, colours.BAND, colours.HEAVIEST_PARTICLE, *colours.SERIES,
             *colours.PARTS, colours.LIGHTEST_PARTICLE, colours.TRAIL]  # fmt: skip
    for colour in lines:
        light = brightness(colour)
        assert min((light + 0.05) / 0.05, 1.05 / (light + 0.05)) > 1.9, colour


def record(path, run, errors):
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in run:
            recorder.log(replace(step, warnings=()), errors(step))
    return path


def static_colours(path):
    """{entity: colour} of the curves."""
    found = {}
    for chunk in RrdReader(path).stream().filter(is_static=True):
        batch = chunk.to_record_batch()
        if "SeriesLines:colors" in batch.schema.names:
            found[chunk.entity_path] = batch.column("SeriesLines:colors").to_pylist()[0][0]
    return found


def rgba(colour):
    red, green, blue = colour
    return red << 24 | green << 16 | blue << 8 | 255


@pytest.mark.parametrize(("first_known", "n_layouts"), [(10, 1), (12, 1), (13, 2)])
def test_an_error_that_is_known_later_joins_the_layout(first_known, n_layouts, tmp_path):
    """The first three frames are written together."""

    def errors(step):
        return {"error_px": 3.0} if step.frame.index >= first_known else {}

    path = record(tmp_path / "run.rrd", steps(4, n_particles=20), errors)
    assert len(RrdReader(path).blueprints()) == n_layouts
    assert static_colours(path)["/metrics/error_px"] == rgba(colours.ESTIMATE)


def test_the_estimate_is_orange_and_the_truth_blue_in_every_plot(tmp_path):
    path = record(tmp_path / "run.rrd", steps(1, n_particles=20), lambda step: {"error_abs_mm": 1.0})
    found = static_colours(path)
    band = "/posterior/parameters/left_knee_flexion"
    assert found[f"{band}/truth"] == rgba(colours.TRUTH)
    assert {found[f"{band}/mean"], found["/metrics/error_abs_mm"], found["/metrics/ess"]} == {rgba(colours.ESTIMATE)}
