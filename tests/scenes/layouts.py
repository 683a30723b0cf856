"""A layout of a recording, by the names of its views."""

from types import SimpleNamespace

import numpy as np

from workbench.recording.write import layout


def posterior_of(**units):
    """Stand in for a posterior with these parameters, each with a picture of its own."""
    return SimpleNamespace(favourites=tuple(units), coefficients=(), unit=units.get)


SHOWN = layout.LayoutInput(
    cameras=(), person=np.zeros(3), towards=np.array([2.0, 0.0]), n_particles=500,
    posterior=posterior_of(left_knee_flexion="rad"),
    metrics=("ess", "log_evidence", "error_abs_mm", "error_abs_mm_map", "error_rel_mm", "error_rel_mm_map",
             "error_px", "error_px_map", "forearm_px", "coverage_90"),
)  # fmt: skip


def views(part):
    """All views of a layout, in order."""
    inner = getattr(part, "contents", None)
    if isinstance(inner, list | tuple) and not hasattr(part, "origin"):
        return [view for child in inner for view in views(child)]
    return [part]


def laid_out(shown):
    """{name: view}, in order."""
    return {view.name: view for view in views(layout.layout(shown).root_container)}
