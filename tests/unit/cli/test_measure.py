"""`workbench measure` writes tables and a page of recorded motion, says what it leaves out, and rejects other input."""

import numpy as np
import pandas as pd
import pytest
from html_page import Page
from walking_scenes import HEIGHT_M, Scene, on_treadmill, record, scene, standing

from workbench.body.limbs import person_with_feet
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES
from workbench.cli.main import main
from workbench.evaluation.gait.angle_cycles import N_POINTS
from workbench.evaluation.gait.strides import SLIDING_SPEED
from workbench.motion.synthetic.gait import average_subject, walker
from workbench.motion.synthetic.run_gait import average_runner, runner

WALKER = average_subject()
RNG = np.random.default_rng(0)


def with_samples(motion, n=20):
    """Add samples that differ by a constant scale of the distance walked, as errors of the height do, and by noise."""
    poses = np.repeat(motion.poses, n, axis=0)
    poses[..., 0] *= 1.0 + RNG.normal(0.0, 0.03, (n, 1))
    poses[..., 3:] += RNG.normal(0.0, 0.01, (n, 1, len(POSE_NAMES) - 3))
    return Scene(motion.skeleton, motion.times_s, np.concatenate([motion.poses, poses]))


def squats(rate_hz=30.0):
    still = standing(8.0, rate_hz)
    knees = 0.8 * (1.0 - np.cos(np.pi * still.times_s))
    for side in ("left", "right"):
        still.poses[0, :, POSE_NAMES.index(f"{side}_knee_flexion")] = knees
        still.poses[0, :, POSE_NAMES.index(f"{side}_hip_flexion")] = 0.9 * knees
    return still


@pytest.fixture
def measured(tmp_path, capsys):
    """A function that records and measures a scene: exit code, standard output, table and angles."""

    def run(motion, *options, **recorded):
        path = record(tmp_path / "run.rrd", motion, **recorded)
        assert main(["measure", str(path), *options]) == 0
        output = capsys.readouterr()
        assert output.err == ""
        tables = [pd.read_csv(tmp_path / name) for name in ("measures.csv", "angles.csv")]
        return output.out, tables[0].set_index(["measure", "side"]), tables[1]

    return run


def test_a_walk_has_its_parameters_with_intervals(measured):
    motion = walker(WALKER, 6.0, 30.0)
    out, table, angles = measured(with_samples(scene(motion)))
    speed = table.loc[("speed", "both")]
    true_speed = (motion.poses[-1, 0] - motion.poses[0, 0]) / 6.0
    assert speed.estimate == pytest.approx(true_speed, rel=0.015)
    assert speed.high_90 - speed.estimate == pytest.approx(1.645 * 0.03 * true_speed, rel=0.5)
    assert speed.low_90 < true_speed < speed.high_90
    assert table.loc[("cadence", "both")].estimate == pytest.approx(120.0 * WALKER.stride_hz, rel=0.01)
    step = table.loc["step_length"].estimate
    assert step["difference"] == pytest.approx(step["left"] - step["right"])
    assert step["left"] == pytest.approx(0.5 * true_speed / WALKER.stride_hz, abs=0.04)
    assert table.loc[("knee_flexion_range", "left")].unit == "deg"
    assert "A walk: 4 strides of the left foot and 4 of the right one" in out
    assert "20 samples of the posterior" in out
    knee = angles[(angles.angle == "knee_flexion") & (angles.side == "left")]
    assert list(knee.percent) == list(range(N_POINTS))
    assert (knee.low_90_deg < knee.mean_deg).all()
    strides = knee[[name for name in angles if name.startswith("stride")]].dropna(axis=1)
    np.testing.assert_allclose(strides.mean(axis=1), knee.mean_deg, atol=0.01)


def test_a_body_with_feet_has_ankle_angles_and_steps_by_its_heels(measured):
    """Feet that are always level move their heels as the ankles."""
    motion = scene(walker(WALKER, 6.0, 30.0))
    plain = measured(motion)[1].estimate
    pitch, hips, knees = (
        np.stack([motion.poses[0, :, POSE_NAMES.index(name)] for name in names], axis=1)
        for names in (
            ("root_pitch",),
            ("left_hip_flexion", "right_hip_flexion"),
            ("left_knee_flexion", "right_knee_flexion"),
        )
    )
    level = pitch - hips + knees
    feet = Scene(None, motion.times_s, np.concatenate([motion.poses, level[None]], axis=2))
    out, table, angles = measured(feet, body=person_with_feet(from_height(HEIGHT_M)))
    for name in ("step_length", "step_width", "stride_length", "stance"):
        np.testing.assert_allclose(table.estimate[name], plain[name], atol=0.02 if name != "stance" else 2.0)
    expected = np.degrees(np.ptp(level[60:], axis=0)).max()
    assert table.loc[("ankle_flexion_range", "left")].estimate == pytest.approx(expected, abs=5.0)
    assert {"left", "right"} == set(angles.side[angles.angle == "ankle_flexion"])
    assert "Conventions" not in out


@pytest.mark.parametrize("make", ["walk", "squats"])
def test_the_page_is_self_contained(measured, tmp_path, make):
    measured(with_samples(scene(walker(WALKER, 6.0, 30.0)) if make == "walk" else squats()))
    text = (tmp_path / "measures.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert not {"script", "link", "iframe", "object", "embed", "img"} & {tag for tag, _ in page.tags}
    assert not [attributes for _, attributes in page.tags if {"src", "href"} & set(attributes)]
    assert "http" not in text.replace("http-equiv", "")
    policy = next(attributes["content"] for _, attributes in page.tags if attributes.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
    charts = [attributes["aria-label"] for tag, attributes in page.tags if tag == "svg"]
    assert {"knee flexion", "hip flexion", "torso tilt"} <= set(charts)
    classes = [attributes.get("class") for tag, attributes in page.tags if tag in ("polyline", "polygon", "line")]
    assert {"curve left", "curve right", "band left", "band right"} <= set(classes)
    assert ("toe-off left" in classes) == (make == "walk")
    for words in ("Grood & Suntay", "Wu et al.", "OpenSim"):
        assert words in page.text
    for tag, attributes in page.tags:
        if tag in ("polyline", "polygon"):
            points = np.array([pair.split(",") for pair in attributes["points"].split()], float)
            assert np.isfinite(points).all()
            assert ((points >= 0.0) & (points <= 400.0)).all()


def test_a_run_and_a_treadmill_are_said(measured):
    out, table, _ = measured(scene(runner(average_runner(), 5.0, 30.0)))
    assert "A run, as both feet leave the ground" in out
    assert table.loc[("double_support", "both")].estimate < 0.0
    motion = scene(walker(WALKER, 6.0, 30.0))
    out, table, _ = measured(on_treadmill(motion, 1.15))
    assert "a treadmill, or a camera that travels along" in out
    assert table.loc[("speed", "both")].estimate == pytest.approx(1.15, rel=0.15)


@pytest.mark.parametrize(("part", "said"), [(0.9, False), (1.1, True)])
def test_feet_that_slide_are_said(measured, part, said):
    motion = scene(walker(WALKER, 8.0, 30.0))
    slope = on_treadmill(motion, 1.0).walk().standing_speed - motion.walk().standing_speed
    speed = (part * SLIDING_SPEED - motion.walk().standing_speed) / slope
    assert ("Standing feet slide" in measured(on_treadmill(motion, speed))[0]) == said


def test_other_motion_has_ranges_speeds_and_repetitions(measured):
    out, table, angles = measured(squats())
    knee = table.loc[("knee_flexion_range", "left")]
    assert (knee.estimate, knee.n) == (pytest.approx(np.degrees(1.6), rel=0.01), 4)
    assert table.loc[("knee_flexion_repetition_time", "left")].estimate == pytest.approx(2.0, abs=0.02)
    peak = table.loc[("knee_flexion_peak_speed", "left")].estimate
    assert peak == pytest.approx(np.degrees(0.8 * np.pi), rel=0.03)
    assert "No walk: no foot takes two steps in turn with the other in 8 s" in out
    assert angles.time_s.max() == pytest.approx(8.0)


def test_a_low_rate_is_no_walk_and_is_said(measured):
    out, table, _ = measured(squats(5.0))
    assert "the frames are 0.2 s apart" in out
    assert "At 5 frames per second peak speeds are lower limits." in out
    assert table.loc[("knee_flexion_range", "left")].n == 4
    assert "At 10 frames per second strikes" in measured(scene(walker(WALKER, 8.0, 10.0)))[0]


@pytest.mark.parametrize("n", [1, 2, 9])
def test_a_clip_of_0_3_s_or_less_is_measured_as_far_as_possible(measured, tmp_path, n):
    out, table, _ = measured(scene(walker(WALKER, 6.0, 30.0)).frames(slice(0, n)))
    assert "No walk" in out
    assert np.isfinite(table.loc[("knee_flexion_range", "left")].estimate) == (n > 1)
    assert Page((tmp_path / "measures.html").read_text(encoding="utf-8")).open == []


@pytest.mark.parametrize(("seconds", "few"), [(4.4, True), (5.0, False)])
def test_three_strides_of_each_foot_are_not_few(measured, seconds, few):
    """Strides of 1.13 s, from strikes at 1.13 s and 0.57 s; the strike at the begin has no frames before it."""
    out, table, _ = measured(scene(walker(WALKER, seconds, 30.0)))
    n = min(table.loc[("stride_time", side)].n for side in ("left", "right"))
    assert (n < 3) == few
    assert ("Fewer than 3 strides of a foot" in out) == few


def test_lost_stretches_are_left_out_and_it_is_said(measured):
    motion = scene(walker(WALKER, 10.0, 30.0))
    whole = measured(motion)[1].loc[("cadence", "both")]
    out, table, _ = measured(motion, lost=range(120, 150))
    assert "In 30 of 301 frames a leg is lost or not seen; strides with a gap are left out." in out
    assert table.loc[("cadence", "both")].estimate == pytest.approx(whole.estimate, rel=0.01)
    assert table.loc[("cadence", "both")].n < whole.n
    out, table, _ = measured(motion.frames(np.r_[0:120, 150:301]))
    assert "no frames in 1 s of its time" in out
    assert table.loc[("cadence", "both")].n < whole.n


def test_parts_that_no_camera_sees_are_not_measured(measured):
    motion = scene(walker(WALKER, 6.0, 30.0))
    n = len(motion.times_s)
    out, table, _ = measured(motion, states={side: ["not seen"] * n for side in ("left_leg", "right_leg")})
    assert "No walk: no frame shows both legs" in out
    assert "Not measured, as they are lost or not seen in most frames: left leg, right leg." in out
    assert not [name for name, _ in table.index if name.startswith(("hip", "knee"))]
    assert ("elbow_flexion_range", "left") in table.index


@pytest.mark.parametrize(("n_hidden", "shown"), [(45, True), (46, False)])
def test_a_part_is_measured_if_it_is_seen_in_half_of_the_frames(measured, n_hidden, shown):
    motion = squats().frames(slice(0, 90))
    table = measured(motion, states={"left_arm": ["lost"] * n_hidden + ["tracked"] * (90 - n_hidden)})[1]
    assert (("elbow_flexion_range", "left") in table.index) == shown


def test_lengths_are_in_proportion_to_the_height(measured):
    config = "dataset: {height_m: 1.65, calibration_file: null}\n"
    assert "in proportion to the person's height, 1.65 m" in measured(standing(1.0), config_yaml=config)[0]
    config = "dataset: {height_m: null, calibration_file: null}\n"
    assert "an average adult's, as none is given" in measured(standing(1.0), config_yaml=config)[0]
    config = "dataset: {height_m: 1.65, calibration_file: camera.toml}\n"
    assert "in proportion" not in measured(standing(1.0), config_yaml=config)[0]


def test_the_folder_is_the_runs_or_the_given_one(tmp_path, capsys):
    record(tmp_path / "run.rrd", standing(1.0))
    assert main(["measure", str(tmp_path), "-o", str(tmp_path / "new" / "measures")]) == 0
    names = {"measures.csv", "angles.csv", "measures.html"}
    assert {path.name for path in (tmp_path / "new" / "measures").iterdir()} == names
    assert str(tmp_path / "new" / "measures" / "measures.html") in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"run.rrd", "new"}


def test_recordings_without_a_person_are_rejected(tmp_path, capsys):
    from small_recordings import record as record_curve

    record_curve(tmp_path / "study.rrd")
    empty = record(tmp_path / "empty.rrd", standing(0.0).frames(slice(0, 0)))
    (tmp_path / "text.rrd").write_text("no recording")
    for path, words in (
        (tmp_path / "study.rrd", "expected a run that tracks a person"),
        (empty, "expected the poses of a person"),
        (tmp_path / "text.rrd", "expected a whole Rerun recording"),
        (tmp_path / "nowhere.rrd", "no such recording"),
    ):
        assert main(["measure", str(path)]) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
    assert not list(tmp_path.glob("*.csv"))
