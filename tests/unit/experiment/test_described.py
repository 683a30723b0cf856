"""What is said of live objects: what they have now, and nothing that is not known."""

import hashlib

import numpy as np

from workbench.core.keys import keeps_keys, kept
from workbench.experiment.provenance import described
from workbench.likelihoods.keypoints import Keypoints
from workbench.priors.smooth import Smooth


class Forgetful:
    """A part of a stranger's that keeps one of its keys."""

    def __init__(self, *, kept: float = 1.0, spent: float = 2.0) -> None:
        self.kept = kept


def test_keys_are_those_that_the_object_has_now():
    prior = Smooth(damping=2.0)
    found = described(prior)
    assert found["_target_"] == "workbench.priors.smooth.Smooth"
    assert (found["damping"], found["start_pose"], found["lowest"]) == (2.0, 2.0, None)
    assert "not_kept" not in found


def test_a_key_that_is_not_kept_is_not_made_up():
    assert described(Forgetful(kept=3.0)) == {
        "_target_": f"{__name__}.Forgetful", "kept": 3.0, "not_kept": ["spent"],
    }  # fmt: skip


def test_arrays_are_written_out_or_identified():
    import dataclasses

    @dataclasses.dataclass
    class Model:
        few: np.ndarray
        many: np.ndarray

    many = np.arange(200.0).reshape(20, 10)
    found = described(Model(np.arange(3), many))
    assert found["few"] == [0, 1, 2]
    assert found["many"] == f"20×10, sha256 {hashlib.sha256(many.tobytes()).hexdigest()}"
    assert described(Model(np.arange(3), many + 1.0))["many"] != found["many"]


def test_a_decorated_class_keeps_what_it_was_built_with():
    part = keeps_keys(type("Own", (Forgetful,), {}))(spent=5.0)
    assert kept(part) == {"kept": 1.0, "spent": 5.0}
    assert described(part)["spent"] == 5.0
    assert kept(Keypoints) == {}
