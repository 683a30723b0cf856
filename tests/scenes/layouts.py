"""A layout of a recording, by the names of its views."""

import numpy as np

from workbench.recording.write import layout

SHOWN = layout.LayoutInput(
    cameras=(), person=np.zeros(3), towards=np.array([2.0, 0.0]), parameters=("root_x", "left_knee_flexion"),
    units=("m", "rad"), pictured=("left_knee_flexion",), n_coefficients=0, n_particles=500,
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
