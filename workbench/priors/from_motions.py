"""Priors that a configuration can name together with the motions they are learned from."""

from workbench.learning.training import activity_model, cyclic_model, gait_model, motion_windows, walking_model
from workbench.priors.activity import Activity
from workbench.priors.cyclic import Cyclic
from workbench.priors.implicit import Implicit
from workbench.priors.learned import learned

walking = learned("walking", __name__, walking_model, Cyclic)
"""Paper A, section 6.2: the cyclic prior over a model learned from whole walking cycles, found by gait events."""
gait = learned("gait", __name__, gait_model, Cyclic)
"""The same with how the root sways in a cycle learned, too, so that less is left to noise."""

cyclic = learned("cyclic", __name__, cyclic_model, Cyclic)
"""Paper B: the same prior over a model learned from any cyclic motion with gaps."""

implicit = learned("implicit", __name__, motion_windows, Implicit)
"""Paper C: a database of motions as a prior."""

activity = learned("activity", __name__, activity_model, Activity)
"""Paper D: one model of walking and running, which least squares fits and a particle filter samples."""
