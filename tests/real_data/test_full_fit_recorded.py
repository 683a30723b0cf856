"""Every joint of recorded people: the flexion their files tell, and a fit in paper D's own setting."""

import numpy as np
import pytest
from least_squares_scenes import Knowing

from workbench.body.angles import flexions
from workbench.body.skeleton import person_skeleton
from workbench.datasets.points import Points
from workbench.evaluation.pose_errors import step_errors
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.motion.full_skeleton import full_poses, full_skeleton
from workbench.motion.models.training import activity_model
from workbench.motion.sources import find_clip, load_motion, read_clip

HELD_OUT = "dataset-2_walk_normal_001"
LEARNED = [f"dataset-2_{activity}_{style}_{k:03d}" for activity in ("walk", "run")
           for style in ("normal", "active", "elderly", "youthful") for k in (2, 3)]  # fmt: skip


@pytest.mark.parametrize("name", [HELD_OUT, "35_02"])
def test_full_skeletons_flex_as_the_retargeted_person(data, name):
    path = find_clip(data, name)
    clip, motion = read_clip(path), load_motion(path)
    skeleton, person = full_skeleton(clip), person_skeleton(motion.shape)
    full, every = full_poses(clip), np.arange(0, len(clip), 8)
    for flexion in ("left_hip", "right_hip", "left_knee", "right_knee"):
        found = np.array([flexions(skeleton, full[i])[flexion] for i in every])
        expected = np.array([flexions(person, motion.poses[i])[flexion] for i in every])
        # retargeting moves the ends of a bone of 0.4 m by up to 1 cm each, and a hip's zero is another
        assert np.std(found - expected) < 3.0
        assert np.ptp(expected) > 30.0


@pytest.mark.slow
def test_a_held_out_walk_is_fitted_with_every_joint(data, tmp_path):
    for name in LEARNED:  # a few clips, so that learning takes seconds
        source = find_clip(data, name)
        link = tmp_path / "bandai" / source.parent.name / source.name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(source)
    # as many components as the experiment points_full
    model = activity_model(motions="bandai", data=str(tmp_path), cache=str(tmp_path), n_components=30, skeleton="full")
    assert len(model.angles) == 60
    dataset = Points(motion=HELD_OUT, data=str(data), first_frame=10, skeleton="full", exact=True)
    body = dataset.known.body
    fit = LeastSquares(body, SurfacePoints(body), Knowing(motion=model))
    streams = {name: np.random.default_rng(0) for name in ("start", "prior")}
    errors = [step_errors(step, body, model.pose_names) for step in fit.run(dataset.frames(), None, streams)]
    mean = {name: np.mean([error[name] for error in errors]) for name in ("error_abs_mm", "knee_deg", "hip_deg")}
    # what a fit of a held-out walk is asked to reach, whatever its skeleton, of the body it is told
    assert mean["error_abs_mm"] < 22.0
    assert mean["knee_deg"] < 4.5
    assert mean["hip_deg"] < 3.5
