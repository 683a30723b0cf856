"""Other methods and ours on the two recorded people, by the same detections.

MediaPipe's world landmarks are joints in 3-D that its network gives for each image. Planar angles are those between the
detected joints in the image, as Sports2D computes them. Ours is `experiment=video` with the camera. The man's truth is
triangulated from another detector's joints; he is seen by each of his cameras alone. The woman's truth is annotated in
the image, in which she walks from side to side: her true angles are planar, too.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from analysis.figures.unrecorded import composed
from analysis.tables import video
from analysis.tables.table import NONE, markdown
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import Frame
from workbench.evaluation.comparison.scores import FrameScores, frame_scores
from workbench.experiment.tracking import assemble, track
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

LANDMARKS, PLANAR, OURS = "MediaPipe's world landmarks", "planar angles of detected joints", "`workbench track`"
_HEADER = ("subject", "method", "knees: RMSE (°)", "elbows: RMSE (°)", "PA-MPJPE (mm)")
_GAP = np.full((len(JOINT_NAMES), 3), np.nan)


def table(data: Path | None, detector: str) -> str:
    """Return the table in Markdown. data: folder of the recordings; raises InputError without it. detector: full, heavy
    or a model."""
    if data is None:
        raise InputError("needs recorded motion: --data FOLDER")
    scores: dict[tuple[str, str], list[FrameScores]] = {}
    subjects = [(name, overrides) for name, overrides in video.rows(data, None) if name == "woman" or "cam_" in name]
    for name, overrides in tqdm(subjects, unit="video", disable=None):
        chosen = ["experiment=video", f"dataset.detector={detector}", f"paths.data={data}", *overrides]
        components = assemble(composed(chosen))
        skeleton = components.body.without_feet.skeleton
        steps = [step for step, _ in track(components, 0)]
        ours = [step.first_parameters(len(skeleton.dof_names)).expected_joints(skeleton) for step in steps]
        for method, each in scored([step.frame for step in steps], ours).items():
            scores.setdefault((name.partition(",")[0], method), []).append(each)
    rows = [[*labels, *cells(each)] for labels, each in scores.items()]
    return markdown([_HEADER, ["---"] * len(_HEADER), *rows])


def scored(frames: list[Frame], ours: list[FloatArray]) -> dict[str, FrameScores]:
    """Return the scores of each method in the frames with a truth, in which `ours` are our joints (J, 3), m."""
    known = [k for k, frame in enumerate(frames) if frame.truth is not None]
    truth = np.stack([_truth(frames[k]) for k in known])
    times_s = np.array([frames[k].time_s for k in known])
    views = [frames[k].views[0] for k in known]
    estimates = {
        LANDMARKS: [_GAP if view.world_landmarks is None else view.world_landmarks for view in views],
        PLANAR: [_GAP if view.keypoints is None else view.keypoints * [1.0, 1.0, 0.0] for view in views],
        OURS: [ours[k] for k in known],
    }
    no_samples = np.empty((0, *truth.shape))
    scores = {
        method: frame_scores(JOINT_NAMES, times_s, np.stack(each), truth, no_samples)
        for method, each in estimates.items()
    }
    is_annotated = any(view_truth.annotations is not None for k in known if (view_truth := frames[k].truth))
    in_plane = {*scores} if is_annotated else {PLANAR}
    return {name: replace(each, scores={}) if name in in_plane else each for name, each in scores.items()}


def _truth(frame: Frame) -> FloatArray:
    """Return the true joints (J, 3), m, or the visible annotations in the image's plane, px."""
    truth = frame.truth
    if truth is None or truth.annotations is None:
        return _GAP if truth is None or truth.joints is None else truth.joints
    seen = True if truth.annotations_visible is None else truth.annotations_visible[:, None]
    return np.where(seen, np.column_stack([truth.annotations, np.zeros(len(JOINT_NAMES))]), np.nan)


def cells(scores: list[FrameScores]) -> list[str]:
    """Return the cells of a row: the root mean square errors of angles, and the PA-MPJPE where it has a unit."""
    texts = []
    for part in ("knee", "elbow"):
        pairs = [pair for each in scores for name, pair in each.angles_deg.items() if name.endswith(part)]
        errors = np.concatenate([own - true for own, true in pairs])
        texts.append(f"{np.sqrt(np.nanmean(errors**2)):.1f}" if np.isfinite(errors).any() else NONE)
    distances = [each.scores["pa_mpjpe"] for each in scores if each.scores]
    return [*texts, f"{np.nanmean(np.concatenate(distances)):.0f}" if distances else NONE]
