"""Accuracy of experiment=video on recorded people: a table over clips and cameras.

    python -m analysis.video_accuracy --data DATA [--detections DIR] [key=value …]

The woman of sports2d_walk with and without her camera, and the man of pose2sim_balance with four cameras and with each
alone. px: 2-D joint error; abs, rel: joint error in the world and root-aligned, mm; sign: fraction of the limbs over 8
cm in depth, seen from the camera, that point the wrong way; cover: fraction of the joints' coordinates in their 90 %
credible intervals. The man's truth is triangulated from another detector's joints. DIR: folders demo and cam01 to cam04
of detections; by default people are detected. No row is of people held out: loss, sigma_px, depth_sigma_m, the
correction of exchanged labels and the standard deviations of joint definitions were chosen with these clips in view.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES
from workbench.experiment.config.schema import composed
from workbench.experiment.tracking import assemble, track
from workbench.utils.arrays import FloatArray

MIN_DEPTH_M = 0.08
LIMBS = tuple(
    (JOINT_NAMES.index(f"{side}_{upper}"), JOINT_NAMES.index(f"{side}_{lower}"))
    for side in ("left", "right")
    for upper, lower in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
)
METRICS = ("mpjpe_px", "mpjpe_abs_mm", "mpjpe_mm", "coverage_90_joints")
CAMERAS = ("cam_01", "cam_02", "cam_03", "cam_04")


def rows(data: Path, detections: Path | None) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the name and the overrides of every run."""
    walk = data / "sports2d_walk"
    keypoints = "detect" if detections is None else str(detections / "demo")
    woman = (
        f"dataset.source={walk / 'demo.mp4'}", f"dataset.keypoints={keypoints}",
        f"dataset.eval_annotations={walk / 'keypoints.csv'}",
    )  # fmt: skip
    yield "woman", (*woman, f"dataset.calibration_file={walk / 'Calib_demo.toml'}", "body.height_m=1.65")
    yield "woman, no camera", (*woman, "dataset.height_m=1.65")
    folders = (f"{camera}:{(detections or Path()) / camera.replace('_', '')}" for camera in CAMERAS)
    files = "detect" if detections is None else f"{{{','.join(folders)}}}"
    man = ("dataset=pose2sim_balance", "dataset.scale=1.0", f"dataset.keypoints={files}")
    yield "man, four cameras", man
    yield from ((f"man, {camera}", (*man, f"dataset.cameras=[{camera}]")) for camera in CAMERAS)


def wrong_signs(camera: Camera, estimate: FloatArray, truth: FloatArray) -> list[bool]:
    """Return, for the limbs over MIN_DEPTH_M in depth among true joints (J, 3), m, whether the estimate (J, 3) has the
    other sign."""

    def depths(places: FloatArray) -> FloatArray:
        first, last = places[list(LIMBS)].swapaxes(0, 1)
        rays = first - camera.position
        return np.asarray(((last - first) * rays).sum(axis=1) / np.linalg.norm(rays, axis=1))

    true, estimated = depths(truth), depths(estimate)
    return list(np.asarray(true * estimated < 0.0)[np.abs(true) > MIN_DEPTH_M])


def measure(overrides: Sequence[str]) -> tuple[float, ...]:
    """Return the means over a run's frames of METRICS, and the fraction of wrong signs."""
    components, errors, wrong = assemble(composed(["experiment=video", *overrides])), [], list[bool]()
    with threadpool_limits(limits=1, user_api="blas"):
        for step, of_step in track(components, 0):
            errors.append([of_step.get(name, np.nan) for name in METRICS])
            if step.frame.truth is not None and step.frame.truth.joints is not None:
                estimate = joints(components.body.skeleton, step.expected_pose[None])[0]
                wrong += wrong_signs(step.frame.views[0].camera, estimate, step.frame.truth.joints)
    values = np.array(errors)
    means = (float(np.nanmean(one)) if np.isfinite(one).any() else np.nan for one in values.T)
    return *means, float(np.mean(wrong)) if wrong else np.nan


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--detections", type=Path)
    parser.add_argument("overrides", nargs="*")
    arguments = parser.parse_args()
    print(f"{'':20} {'px':>6} {'abs':>7} {'rel':>7} {'cover %':>8} {'sign %':>7}")
    for name, overrides in rows(arguments.data, arguments.detections):
        px, absolute, relative, covered, sign = measure(
            [*overrides, f"paths.data={arguments.data}", *arguments.overrides]
        )
        print(
            f"{name:20} {px:6.1f} {absolute:7.1f} {relative:7.1f} {100.0 * covered:8.1f} {100.0 * sign:7.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
