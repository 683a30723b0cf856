"""Verdicts of claims on synthetic results, and the measures of claims."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_steps import BODY, steps

from analysis.claims import __main__ as command
from analysis.claims.claim import Claim, Setup, Verdict, both, lost, ratio, tracked, within
from analysis.claims.listed import CLAIMS, activity_right, raised_knee_deg, rotation_growth, spread_growth
from analysis.claims.measures import arms_poorest, at_most, gait, own_motions_mm, separated
from analysis.command import chosen
from analysis.figures.recordings import Source
from analysis.figures.step_values import wrong_signs
from analysis.figures.unrecorded import Result
from workbench.body.kinematics import joints
from workbench.motion.models.activity_cycles import ActivityCycles
from workbench.utils.errors import InputError

SOURCE = Source(None, None, quick=True)


def run(*, lost_from=None, root_aligned_mm=50.0, n=50, **series):
    """Return a run with errors of 5 px, and of 100 px from frame `lost_from` on; forearms are 20 px wide."""
    pixels = np.full(n, 5.0)
    if lost_from is not None:
        pixels[lost_from:] = 100.0
    errors = {"mpjpe_px": pixels, "forearm_width_px": np.full(n, 20.0), "mpjpe_mm": np.full(n, root_aligned_mm)}
    series = {name: list(values) for name, values in {**errors, "mpjpe_abs_mm": np.full(n, 90.0), **series}.items()}
    return Result({name: float(np.mean(values)) for name, values in series.items()}, series, 1.0)


def test_a_track_is_lost_by_image_error_or_by_root_aligned_error():
    assert not lost(run()).any()
    assert np.flatnonzero(lost(run(lost_from=30)))[0] == 30
    assert lost(run(root_aligned_mm=151.0)).all()
    assert not lost(run(root_aligned_mm=149.0)).any()


@given(st.integers(0, 10), st.sampled_from([0.0, 0.1, 0.2, 0.8, 0.9]))
def test_a_tracking_claim_holds_by_the_fraction_of_tracked_seeds(n_tracked, fraction):
    results = [run()] * n_tracked + [run(lost_from=30)] * (10 - n_tracked)
    assert tracked(fraction)(SOURCE, results).holds == (n_tracked >= round(10 * fraction))
    assert tracked(at_most=fraction)(SOURCE, results).holds == (n_tracked <= round(10 * fraction))
    assert tracked(1.0, last_frame=29)(SOURCE, results).holds


def test_limits_apply_to_metrics_and_to_values_of_several_setups():
    first, second = [Result({"error": value}, {}, 1.0) for value in (3.0, 5.0)], [Result({"error": 2.0}, {}, 1.0)]
    assert within("error", "error", high=4.0)(SOURCE, first).holds
    assert not within("error", "error", high=3.9)(SOURCE, first).holds
    assert within("over", ratio("error"), 2.0, 2.0)(SOURCE, first, second).holds
    assert not within("error", "error", 4.1)(SOURCE, first).holds
    limits = within("error", "error", high=4.0), within("error", "error", high=3.0)
    assert not both(*limits)(SOURCE, first).holds
    assert not within("undefined", lambda _: float("nan"), 0.0)(SOURCE, first).holds
    with pytest.raises(InputError, match="coverage"):
        within("missing", "coverage", 0.0)(SOURCE, first)


def test_arms_are_poorest_by_their_error_over_their_own_motion():
    """Relative to the pelvis, ankles move by tens of centimetres in a walk and wrists by fewer."""
    motions = own_motions_mm("builtin", None)
    assert 20.0 < motions["arms"] < 0.8 * motions["legs"] < 200.0
    equal = motions["arms"] / motions["legs"]
    for factor, holds in ((0.99, False), (1.01, True)):
        walk = run(mpjpe_legs_mm=np.full(50, 30.0), mpjpe_arms_mm=np.full(50, 30.0 * equal * factor))
        assert arms_poorest(SOURCE, [walk]).holds == holds


def test_growth_of_rotation_error_and_error_of_the_raised_knee():
    growing = run(root_rotation_deg=np.linspace(1.0, 21.0, 50))
    assert rotation_growth([growing]) > 4.0
    assert rotation_growth([run(root_rotation_deg=np.ones(50))]) == 1.0
    flexed = np.arange(50.0)
    knee = run(highest_knee_deg=flexed, knee_flexion_rmse_deg=np.where(flexed >= 45.0, 7.0, 1.0))
    assert raised_knee_deg([knee]) == pytest.approx(7.0)
    by_beta = [[Result({"distance_search": value}, {}, 1.0)] for value in (1.0, 2.0, 3.0, 3.3)]
    assert spread_growth("search", *by_beta) == pytest.approx(0.1)


def test_the_activity_counts_outside_the_three_frames_of_the_transition():
    first_of_the_run = 6  # in the series, which begins with frame 1: of 14 frames the eighth
    for k, right in ((first_of_the_run - 2, 0.9), (first_of_the_run - 1, 1.0), (first_of_the_run + 1, 1.0)):
        assert activity_right([run(n=13, activity_accuracy=np.arange(13) != k)]) == right


def test_no_person_has_more_cycles_than_the_limit_of_an_activity():
    activities = ("walk",) * 7 + ("run",) * 3
    cycles = ActivityCycles(("a",), np.arange(10.0)[:, None, None], np.ones(10), activities, tuple("xxxxxyyxxx"))
    chosen = at_most(cycles, {"x": "first", "y": "second"}, {"walk": 2, "run": 3})
    assert chosen.curves.ravel().tolist() == [1.0, 3.0, 5.0, 6.0, 7.0, 8.0, 9.0]


@given(st.floats(1.5, 4.0), st.floats(0.0, 1.0))
def test_regular_steps_have_their_frequency_and_no_variation(frequency_hz, phase):
    times_s = np.arange(240) / 120.0
    measured_hz, _ = gait(30.0 * np.sin(np.pi * frequency_hz * times_s + np.pi * phase), 120.0)
    if np.isfinite(measured_hz):
        assert measured_hz == pytest.approx(frequency_hz, rel=0.12)  # the mean over a partial stride is not zero
    assert np.isnan(gait(np.ones(60), 30.0)).all()


def test_separation_by_a_line_is_the_fraction_of_correct_points():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2))
    assert separated(points, points @ [1.0, 2.0] > 0.3) == 1.0
    assert 0.4 < separated(points, points[:, 0] * points[:, 1] > 0.0) < 0.8


def test_a_limb_mirrored_in_depth_has_the_wrong_sign():
    step = next(steps(1, n_particles=40))
    camera, truth = step.frame.views[0].camera, joints(BODY.skeleton, step.frame.truth.pose[None])[0]
    elbow, wrist = (BODY.skeleton.joint(f"right_{name}") for name in ("elbow", "wrist"))
    ray = truth[elbow] - camera.position
    forearm = 0.3 * ray / np.linalg.norm(ray)
    estimate = truth.copy()
    truth[wrist], estimate[wrist] = truth[elbow] - forearm, truth[elbow] + forearm
    assert sum(wrong_signs(camera, estimate, truth)) == 1
    assert sum(wrong_signs(camera, truth, truth)) == 0


def test_claims_have_unique_names_and_are_chosen_by_prefix():
    names = [claim.name for claim in CLAIMS]
    assert len(set(names)) == len(names)
    assert chosen(["C6"], names) == ["C6a", "C6b", "C6c"]
    assert chosen([], names) == names
    with pytest.raises(InputError, match="Z9"):
        chosen(["Z9"], names)


def test_the_exit_code_is_one_if_a_claim_without_a_reason_fails(monkeypatch, tmp_path, capsys):
    failing = Claim("X1", "never", (), lambda source: Verdict(False, "0"), ("ours",))
    explained = Claim("X2", "never", (), lambda source: Verdict(False, "0"), ("ours",), {"ours": "why"})
    holding = Claim("X3", "always", (), lambda source: Verdict(True, "1"), ("ours",))
    needs_data = Claim("X4", "unknown", (Setup("body_implicit"),), tracked(), ("ours",))
    arguments = ["--runs", str(tmp_path)]
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    for claims, code in (((explained, holding, needs_data), 0), ((failing, holding), 1)):
        monkeypatch.setattr(command, "CLAIMS", claims)
        assert command.main(arguments) == code
    assert command.main(["Y", *arguments]) == 2
    assert command.main(["X3", "-o", str(tmp_path / "claims.md"), *arguments]) == 0
    assert "| X3 | ours | always | 1 | holds |" in (tmp_path / "claims.md").read_text(encoding="utf-8")
    assert command.NOT_MEASURED in capsys.readouterr().out
