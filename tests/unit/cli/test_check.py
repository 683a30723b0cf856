"""What `workbench check` prints before it runs anything: changes that it refuses, and how two recordings differ."""

from pathlib import Path

from workbench.cli.main import main

BASELINES = Path(__file__).parents[3] / "recordings" / "baselines"


def test_another_part_is_refused_in_a_sentence_that_says_what_runs_it(capsys):
    recording = BASELINES / "walk_prior_only.rrd"
    assert main(["check", str(recording), "inference=annealed"]) == 2
    told = capsys.readouterr().out
    assert "REFUSED" in told
    assert "inference of a recording is a component" in told
    assert f"workbench run from={recording} inference=annealed" in told


def test_of_two_recordings_the_keys_that_differ_are_told(capsys):
    first, second = (str(BASELINES / f"{name}.rrd") for name in ("points_walk_steady", "points_walk_variable"))
    assert main(["check", first, second]) == 1
    head, *rows = capsys.readouterr().out.splitlines()
    assert head == "different configurations:"
    assert "  inference.problem.frames_per_style: None → missing" in rows
