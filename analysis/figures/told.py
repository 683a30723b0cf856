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
    if "error_px" in result:
        words.append(f"{result['error_px']:.1f} px in the image")
    if "error_abs_mm" in result:
        words.append(f"{result['error_abs_mm']:.0f} mm in space")
    if "error_rel_mm" in result and abs(result["error_rel_mm"] - result["error_abs_mm"]) > 0.5:  # the root moves
        words.append(f"{result['error_rel_mm']:.0f} mm with pelvis on pelvis")
    held = {1.0: "; held", 0.0: "; lost"}.get(result.get("held", -1.0), "")
    return f"joints off by {', '.join(words)}{held}" if words else "no truth to compare with"


def legs(run: Run) -> str:
    """Root mean square errors of the legs' flexions, degrees."""
    return f"hips off by {run.result['hip_deg']:.1f}°, knees by {run.result['knee_deg']:.1f}° (root mean square)"
