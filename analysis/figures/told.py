"""What a figure says of a run in words: how it was made, and its numbers."""

from workbench.recording.read.reader import Run

GENERATED = {"builtin": "a generated walker", "builtin_run": "a generated runner", "builtin_arm": "a generated arm"}


def setup(run: Run) -> str:
    """The motion, how many frames and, where there are any, particles."""
    settings = run.settings
    motion = settings["dataset"]["motion"]
    clips = motion if isinstance(motion, list) else [motion]
    words = [" and ".join(GENERATED.get(str(clip), str(clip)) for clip in clips), f"{len(run.poses[0])} frames"]
    n_particles = settings["inference"].get("n_particles")
    if n_particles is not None and "problem" not in settings["inference"]:  # a fit draws some to show its bands
        words.append(f"{n_particles} particles")
    return ", ".join(words)


def accuracy(run: Run) -> str:
    """The mean errors of the expected pose over the frames after the first, and whether the person was held."""
    result = run.result
    words = []
    if "mpjpe_px" in result:
        words.append(f"{result['mpjpe_px']:.1f} px in the image")
    if "mpjpe_abs_mm" in result:
        words.append(f"{result['mpjpe_abs_mm']:.0f} mm in space")
    if "mpjpe_mm" in result and abs(result["mpjpe_mm"] - result["mpjpe_abs_mm"]) > 0.5:  # the root moves
        words.append(f"{result['mpjpe_mm']:.0f} mm with pelvis on pelvis")
    held = {1.0: "; held", 0.0: "; lost"}.get(result.get("tracked", -1.0), "")
    return f"joints off by {', '.join(words)}{held}" if words else "no truth to compare with"


def legs(run: Run) -> str:
    """Root mean square errors of the legs' flexions, degrees."""
    hip, knee = run.result["hip_flexion_rmse_deg"], run.result["knee_flexion_rmse_deg"]
    return f"hips off by {hip:.1f}°, knees by {knee:.1f}° (root mean square)"
