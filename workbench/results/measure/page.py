"""The page of measures, as HTML without scripts and loading."""

from workbench.evaluation.gait.joint_angles import CONVENTIONS
from workbench.results.formatting import table_of
from workbench.results.measure import charts
from workbench.results.measure.display import display
from workbench.results.measure.measures import Measures
from workbench.results.pages import environment

_SHAPE = {"width": charts.WIDTH, "height": charts.HEIGHT, "left": charts.LEFT, "right": charts.RIGHT,
          "top": charts.TOP, "bottom": charts.BOTTOM}  # fmt: skip


def page(title: str, measures: Measures) -> str:
    """Return the page of measures: sentences, the table, charts of the angles and their conventions."""
    names = dict.fromkeys(curve.name for curve in measures.curves)
    rows = [(each.title, each.positive, each.source) for each in (CONVENTIONS[name] for name in names)]
    conventions = table_of(("angle", "positive", "definition"), rows)
    drawn = {"table": display(measures), "charts": charts.charts_of(measures), "conventions": conventions}
    template = environment().get_template("measure/measures.html")
    return template.render(title=title, measures=measures, **drawn, **_SHAPE)
