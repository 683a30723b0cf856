"""Descriptions of a run in a figure's caption: how it was made, and its results."""

from workbench.recording.read.reader import Run

GENERATED = {"builtin": "a generated walker", "builtin_run": "a generated runner", "builtin_arm": "a generated arm"}


def setup(run: Run) -> str:
    """Return the motion, the number of frames and, if there are any, of particles."""
    settings = run.settings
    motion = settings["dataset"]["motion"]
    clips = motion if isinstance(motion, list) else [motion]
    words = [" and ".join(GENERATED.get(str(clip), str(clip)) for clip in clips), f"{len(run.poses[0])} frames"]
    n_particles = settings["inference"].get("n_particles")
    if n_particles is not None and "problem" not in settings["inference"]:  # a fit samples some to show its intervals
        words.append(f"{n_particles} particles")
    return ", ".join(words)


def accuracy(run: Run) -> str:
    """Return the mean errors of the expected pose over the frames after the first, and whether the person was
    tracked."""
    result = run.result
    words = []
    if "mpjpe_px" in result:
        words.append(f"{result['mpjpe_px']:.1f} px in the image")
    if "mpjpe_abs_mm" in result:
        words.append(f"{result['mpjpe_abs_mm']:.0f} mm in space")
    if "mpjpe_mm" in result and abs(result["mpjpe_mm"] - result["mpjpe_abs_mm"]) > 0.5:  # the root moves
        words.append(f"{result['mpjpe_mm']:.0f} mm root-aligned")
    outcome = {1.0: "; tracked", 0.0: "; lost"}.get(result.get("tracked", -1.0), "")
    return f"mean joint error {', '.join(words)}{outcome}" if words else "no ground truth"


def legs(run: Run) -> str:
    """Return the root mean square errors of the legs' flexions, degrees."""
    hip, knee = run.result["hip_flexion_rmse_deg"], run.result["knee_flexion_rmse_deg"]
    return f"error of hips {hip:.1f}°, knees by {knee:.1f}° (root mean square)"
