"""A recording's layout shows the verdict, errors, uncertainty and the posterior in this order, without empty panels."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rerun.blueprint as rrb
from recorded import record, static
from recording_steps import CAMERA, steps
from rerun.chunk import RrdReader

from workbench.recording.write import layout, recorder, styles
from workbench.recording.write.images import recorded_camera
from workbench.recording.write.posterior import RANKS


def posterior_of(**units):
    """Return a stub of a posterior with a picture per parameter."""
    return SimpleNamespace(shown_parameters=tuple(units), coefficients=(), unit=units.get)


SHOWN = layout.LayoutInput(
    cameras=(), person=np.zeros(3), towards=np.array([2.0, 0.0]), n_particles=500,
    posterior=posterior_of(left_knee_flexion="rad"),
    metrics=("ess", "log_evidence", "mpjpe_abs_mm", "mpjpe_abs_mm_max_weight", "mpjpe_mm", "mpjpe_mm_max_weight",
             "mpjpe_px", "mpjpe_px_max_weight", "forearm_width_px", "coverage_90"),
)  # fmt: skip


def views(block):
    """Return all views of a layout, in order."""
    children = getattr(block, "contents", None)
    if isinstance(children, list | tuple) and not hasattr(block, "origin"):
        return [view for child in children for view in views(child)]
    return [block]


def views_by_name(shown):
    """Return {name: view}, in order."""
    return {view.name: view for view in views(layout.layout(shown).root_container)}


def metric_panels(shown):
    """Return {names of metrics: view} of the panels that show metrics, in order."""
    panels = {}
    for view in views_by_name(shown).values():
        paths = view.contents if isinstance(view.contents, list) else [str(view.origin)]
        if metrics := tuple(path.removeprefix("/metrics/") for path in paths if path.startswith("/metrics/")):
            panels[metrics] = view
    return panels


def test_verdict_errors_uncertainty_and_posterior_follow_in_this_order():
    views = [*views_by_name(SHOWN).values()]
    assert views[0].origin == "/verdict"
    origins = [str(view.contents) + str(view.origin) for view in views]
    shown = ["mpjpe_abs_mm", "mpjpe_px", "metrics/ess", "coverage_90", "left_knee_flexion"]
    indices = [next(k for k, text in enumerate(origins) if name in text) for name in shown]
    assert indices == sorted(indices)


def test_only_recorded_quantities_have_panels():
    ess_only = replace(SHOWN, metrics=("ess",))
    assert [*metric_panels(ess_only)] == [("ess",)]
    assert not metric_panels(replace(ess_only, uninformative=frozenset({"ess"})))
    assert {*views_by_name(replace(ess_only, warned=True))} - {*views_by_name(ess_only)} == {"warnings"}
    with_lanes = replace(ess_only, lanes=("tracking", "large_expected_error"))
    assert len(views_by_name(with_lanes)) == len(views_by_name(ess_only)) + 1
    cameras = [recorded_camera(replace(CAMERA, name=name)) for name in ("a", "b", "c", "d")]
    assert {"a", "b", "c", "d"} <= set(views_by_name(replace(SHOWN, cameras=cameras)))
    paths = ("reprojection_error_px/a", "reprojection_error_px/forearm")
    panels = views_by_name(replace(ess_only, reprojection_errors=paths)).values()
    (view,) = [view for view in panels if f"/{paths[0]}" in view.contents]
    assert view.contents == [f"/{path}" for path in paths]
    with_truth = replace(SHOWN, reprojection_errors=paths)  # true errors replace reprojection errors
    assert views_by_name(with_truth).keys() == views_by_name(SHOWN).keys()
    with_ranks = replace(SHOWN, metrics=(*SHOWN.metrics, "nll"))
    assert tab(with_ranks, "calibration") == [f"/{RANKS}", "/metrics/nll"]
    assert tab(with_ranks, "numbers") == tab(SHOWN, "numbers") == ["/metrics/log_evidence"]
    without_ranks = replace(SHOWN, metrics=(*SHOWN.metrics, "crps_mm"))
    assert tab(without_ranks, "calibration") == ["/metrics/crps_mm"]


def parents(shown, name):
    """Return (container, k) for every child k of the name."""
    containers = [layout.layout(shown).root_container]
    for block in containers:
        containers += [child for child in block.contents if isinstance(child, rrb.Container)]
    return [(each, k) for each in containers for k, child in enumerate(each.contents) if child.name == name]


def tab(shown, name):
    """Return the origins of the views in a tab."""
    ((tabs, k),) = parents(shown, name)
    return [view.origin for view in views(tabs.contents[k])]


def heights(shown, name):
    """Return the relative heights of the stack that holds the view of a name, that view's first."""
    ((stack, k),) = parents(shown, name)
    return [stack.row_shares[k], *np.delete(stack.row_shares, k)]


@pytest.mark.parametrize("n", [1, 3])
def test_lanes_have_008_of_the_height_of_images_and_world_each_and_so_has_their_axis(n):
    cameras = [recorded_camera(CAMERA)]
    lane, *others = heights(
        replace(SHOWN, cameras=cameras, lanes=("tracking",) * n), "states: tracked, doubtful or lost"
    )
    assert lane == pytest.approx(0.08 * (n + 1) * sum(others))
    assert others == [1.0, 1.0]


@pytest.mark.parametrize(("n_characters", "height"), [(0, 1.0), (190, 1.0), (191, 1.3), (380, 1.3), (381, 1.6)])
def test_a_verdict_of_several_lines_is_higher(n_characters, height):
    verdict, rest = heights(replace(SHOWN, n_characters=n_characters), "verdict")
    assert verdict / rest == pytest.approx(height / 12.0)


@pytest.mark.parametrize(("first_frame", "n_layouts"), [(10, 1), (12, 1), (13, 2)])
def test_a_metric_of_later_frames_is_added_to_the_layout(first_frame, n_layouts, tmp_path, monkeypatch):
    """Frames are written in groups of three. The estimate and its errors have one colour, the truth another."""

    def errors(step):
        return {"mpjpe_px": 3.0} if step.frame.index >= first_frame else {}

    monkeypatch.setattr(recorder, "FLUSH_S", np.inf)
    monkeypatch.setattr(recorder, "MAX_FLUSH_EVERY", 3)
    run = [replace(step, warnings=()) for step in steps(4, n_particles=20)]
    path = record(tmp_path / "run.rrd", run, errors)
    assert len(RrdReader(path).blueprints()) == n_layouts
    parameter = "/posterior/parameters/left_knee_flexion"
    entities = (f"{parameter}/truth", f"{parameter}/mean", "/metrics/mpjpe_px", "/metrics/ess")
    truth, *estimates = [static(path, entity, "SeriesLines:colors")[0].to_bytes(4, "big")[:3] for entity in entities]
    assert truth == bytes(styles.TRUTH)
    assert set(estimates) == {bytes(styles.ESTIMATE)}


def test_expected_and_true_errors_by_joint_group_have_a_plot_each_with_a_legend():
    both = [f"{kind}_{group}_mm" for kind in ("expected_error", "mpjpe_abs") for group in styles.GROUPS]
    panels = metric_panels(replace(SHOWN, metrics=(*SHOWN.metrics, *both)))
    for panel in (panels[tuple(both[:4])], panels[tuple(both[4:])]):
        visible = panel.properties["PlotLegend"].visible
        assert visible is None or visible.as_arrow_array().to_pylist() == [True]
