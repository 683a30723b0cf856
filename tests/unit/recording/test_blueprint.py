"""What a recording's layout shows first: how wrong the estimate is, how sure, and no empty panels."""

from dataclasses import replace

import pytest
from layouts import SHOWN, laid_out
from recording_steps import BODY, SPACE, steps
from rerun.chunk import RrdReader

from workbench.recording.write import colours
from workbench.recording.write.recorder import Recorder


def test_errors_come_first_then_certainty_then_the_posterior():
    names = list(laid_out(SHOWN))
    expected = [
        "distance from the true joints (mm)", "distance in the image (pixels)", "effective sample size (of 500)",
        "truth inside the 5–95 % bands (0.9 is right)", "left knee flexion (rad)",
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


@pytest.mark.parametrize(("first_known", "n_layouts"), [(10, 1), (12, 2)])
def test_an_error_that_is_known_later_joins_the_layout(first_known, n_layouts, tmp_path):
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
