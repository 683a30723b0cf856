"""The papers' figures of tracked and fitted sequences, as the papers write the experiments and as ours."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, PaperFigure, Reading
from analysis.figures.sequences import compared, fitted, tracked


def _tracked(title: str, experiment: str, paper: str) -> PaperFigure:
    """Return the figure of one experiment: images, the expected pose in space, and errors."""
    return PaperFigure((experiment,), BOTH, lambda readings: tracked(title, readings[experiment], paper))


def _fitted(title: str, experiment: str, paper: str) -> PaperFigure:
    """Return the figure of one fit to points, in frames from the first to the last."""
    return PaperFigure((experiment,), BOTH, lambda readings: fitted(title, readings[experiment], paper))


def _compared(title: str, experiments: Mapping[str, str], paper: str) -> PaperFigure:
    """Return the figure of several experiments by their labels: a row of images each, and all errors over frames."""

    def draw(readings: Mapping[str, Reading]) -> Figure:
        return compared(title, {label: readings[name] for label, name in experiments.items()}, paper)

    return PaperFigure(tuple(experiments.values()), BOTH, draw)


def _walk_cyclic(readings: Mapping[str, Reading]) -> Figure:
    """Draw images above, the expected pose in space below."""
    missing = 100 * readings["walk_cyclic"].ours.settings["prior"]["missing_fraction"]
    paper = (
        f"Learned with {missing:.0f} % of the samples missing. The paper: 10 000 particles, tracked; no errors given."
    )
    return tracked("Paper B, fig. 2: a walk under the cyclic prior", readings["walk_cyclic"], paper)


FIGURES = {
    "a_fig5_walk_straight": _tracked(
        "Paper A, fig. 5: a walk in a straight line", "walk_straight",
        "The paper: 5000 particles, 50 frames, tracked; arms often poorly estimated; no errors given.",
    ),
    "a_fig6_walk_circle": _tracked(
        "Paper A, fig. 6: a walk on a circle", "walk_circle",
        "The paper: 15 000 particles; in frame 50 the model starts to drift off, its rotation poorly estimated.",
    ),
    "a_fig7_prior_only": _compared(
        "Paper A, fig. 7: how strong is the walking prior?",
        {"Image motion": "walk_straight", "Prior only": "walk_prior_only"},
        "The paper repeats the walk on a circle so, as does the literal row, ours the straight one: the prior keeps "
        "the pose that of a walk, but without images the figure walks its own way.",
    ),
    "b_fig2_walk_cyclic": PaperFigure(("walk_cyclic",), BOTH, _walk_cyclic),
    "c_fig6_arm": _compared(
        "Paper C, fig. 6: an arm, 300 particles",
        {
            "(a) implicit prior": "arm_implicit", "(b) constant velocity": "arm_smooth_300",
            "constant velocity, more particles": "arm_smooth_3000",
        },
        "The paper: 300 particles suffice with the implicit prior, constant velocity needs 3000.",
    ),
    "c_fig7_body": _compared(
        "Paper C, fig. 7: a walker, 300 particles",
        {"(a) implicit prior": "body_implicit", "(b) constant velocity": "body_smooth"},
        "The paper: 300 particles track 30 frames with the implicit prior and do not with constant velocity.",
    ),
    "d_fig3_no_model": _fitted(
        "Paper D, fig. 3: no motion model", "points_no_model",
        "The paper: both legs are attracted to the same points; no errors given.",
    ),
    "d_fig5_walk_steady": _fitted(
        "Paper D, fig. 5: a walk in one style", "points_walk_steady",
        "The paper: the legs are correctly positioned; no errors given.",
    ),
    "d_fig7_run_steady": _fitted(
        "Paper D, fig. 7: a run in one style", "points_run_steady",
        "The paper: the legs are right but for the left one in the first frame.",
    ),
    "d_fig8_run_variable": _fitted(
        "Paper D, fig. 8: a run, style varying", "points_run_variable",
        "The paper: the legs are right in the whole sequence.",
    ),
    "d_fig9_walk_variable": _fitted(
        "Paper D, fig. 9: a walk, style varying", "points_walk_variable",
        "The paper: 18 frames, the legs are right; no errors given.",
    ),
}  # fmt: skip
