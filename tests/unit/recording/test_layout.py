"""What a recording's layout shows first: errors, then certainty, then the posterior, and no empty panels."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from layouts import SHOWN, laid_out, posterior_of, views
from recorded import record, static
from recording_steps import CAMERA, steps
from rerun.chunk import RrdReader

from workbench.recording.write import layout, styles
from workbench.recording.write.images import picture
from workbench.recording.write.posterior import DEGREES, RANKS
from workbench.recording.write.scene import ACTIVITY, FLEXION

FIT = replace(
    SHOWN, posterior=posterior_of(root_x="m"), metrics=("error_abs_mm", "error_abs_mm_map", "ess"), n_particles=20,
    flexions=("left_knee", "left_hip"), activity=True, surface=True, drawn=frozenset({"truth", "particles"}),
)  # fmt: skip


def contents_of(shown):
    """{names of metrics: view} of the panels that show metrics, in order."""
    panels = {}
    for view in laid_out(shown).values():
        shown_in = view.contents if isinstance(view.contents, list) else [str(view.origin)]
        if metrics := tuple(path.removeprefix("/metrics/") for path in shown_in if path.startswith("/metrics/")):
            panels[metrics] = view
    return panels


def test_the_verdict_comes_first_then_errors_then_certainty_then_the_posterior():
    views = [*laid_out(SHOWN).values()]
    assert views[0].origin == "/verdict"
    origins = [str(view.contents) + str(view.origin) for view in views]
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
    assert not contents_of(replace(blind, constant=frozenset({"ess"})))
    assert {*laid_out(replace(blind, warned=True))} - {*laid_out(blind)} == {"warnings"}
    assert len(laid_out(replace(blind, lanes=("person", "do_not_trust")))) == len(laid_out(blind)) + 1
    cameras = [picture(replace(CAMERA, name=name)) for name in ("a", "b", "c", "d")]
    assert {"a", "b", "c", "d"} <= set(laid_out(replace(SHOWN, cameras=cameras)))
    paths = ("residual_px/a", "residual_px/forearm")
    (view,) = [view for view in laid_out(replace(blind, residuals=paths)).values() if "/residual_px/a" in view.contents]
    assert view.contents == [f"/{path}" for path in paths]
    assert laid_out(replace(SHOWN, residuals=paths)).keys() == laid_out(SHOWN).keys()  # the truth says more
    known = replace(SHOWN, metrics=(*SHOWN.metrics, "log_score"))
    assert [f"/{RANKS}" in [v.origin for v in laid_out(each).values()] for each in (SHOWN, known)] == [False, True]


def test_a_fit_is_laid_out_by_flexion_and_activity():
    found = laid_out(FIT)
    names, errors = list(found), "distance from the true joints (mm)"
    assert names.index("left hip flexion (degrees)") < names.index("left knee flexion (degrees)") < names.index(errors)
    assert found["left knee flexion (degrees)"].origin == f"/{FLEXION}/left_knee"
    assert found["activity"].origin == f"/{ACTIVITY}"
    world = "world: estimate orange, truth blue, particles purple"
    assert "- /world/estimate/body" in found[world].contents  # the surface stands for the limbs
    assert found[errors].contents == ["/metrics/error_abs_mm"]  # a fit's heaviest particle is the expected pose
    plain = laid_out(replace(FIT, activity=False, surface=False))
    assert "activity" not in plain
    assert "- /world/estimate/body" not in plain[world].contents


def test_shares_of_cues_have_a_view_of_their_own():
    panels = contents_of(replace(FIT, metrics=("error_abs_mm", "ess", "share_background", "share_edges")))
    assert ("share_background", "share_edges") in panels
    assert ("share_edges",) not in panels


def test_angles_are_drawn_in_degrees():
    shown = views(layout.layout(SHOWN).root_container)
    origins = {view.origin for view in shown if "left_knee_flexion" in str(view.origin)}
    assert origins == {f"/{DEGREES}/left_knee_flexion", "/posterior/pictures/left_knee_flexion"}


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


@pytest.mark.parametrize(("first_known", "n_layouts"), [(10, 1), (12, 1), (13, 2)])
def test_an_error_that_is_known_later_joins_the_layout(first_known, n_layouts, tmp_path):
    """The first three frames are written together. The estimate and its errors have one colour, the truth another."""

    def errors(step):
        return {"error_px": 3.0} if step.frame.index >= first_known else {}

    run = [replace(step, warnings=()) for step in steps(4, n_particles=20)]
    path = record(tmp_path / "run.rrd", run, errors)
    assert len(RrdReader(path).blueprints()) == n_layouts
    band = "/posterior/parameters/left_knee_flexion"
    entities = (f"{band}/truth", f"{band}/mean", "/metrics/error_px", "/metrics/ess")
    truth, *estimates = [static(path, each, "SeriesLines:colors")[0].to_bytes(4, "big")[:3] for each in entities]
    assert truth == bytes(styles.TRUTH)
    assert set(estimates) == {bytes(styles.ESTIMATE)}
