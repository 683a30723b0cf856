"""`workbench check` rejects other components and prints the configuration keys in which two recordings differ."""

from pathlib import Path

from workbench.cli.main import main

BASELINES = Path(__file__).parents[3] / "recordings" / "baselines"


def test_another_component_is_refused_with_the_command_that_runs_it(capsys):
    recording = BASELINES / "walk_prior_only.rrd"
    assert main(["check", str(recording), "inference=annealed"]) == 2
    output = capsys.readouterr().out
    assert "REFUSED" in output
    assert "inference of a recording is a component" in output
    assert f"workbench run from={recording} inference=annealed" in output


def test_the_keys_in_which_two_recordings_differ_are_printed(capsys):
    first, second = (str(BASELINES / f"{name}.rrd") for name in ("points_walk_steady", "points_walk_variable"))
    assert main(["check", first, second]) == 1
    header, *rows = capsys.readouterr().out.splitlines()
    assert header == "different configurations:"
    assert "  inference.problem.frames_per_style: None → missing" in rows
