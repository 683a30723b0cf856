"""The command `workbench`: its subcommands, imported when they are called, and their exit codes."""

import inspect
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from shlex import join
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from workbench import __version__
from workbench.utils.signals import ending_at_once

COMMANDS = {
    "run": ("run:app", "Run", "Run an experiment, or a sweep with -m."),
    "track": ("track:track", "Run", "Track a person in a video, from the file alone."),
    "components": ("components:components", "Run", "List the experiments and components, and the keys of one."),
    "runs": ("runs:app", "Inspect", "List, query, compare and remove recorded runs."),
    "view": ("view:view", "Inspect", "Open recordings in the viewer."),
    "measure": ("measure:measure", "Inspect", "Measure steps, speed and joint angles of a recorded motion."),
    "report": ("report:report", "Compare", "Summarize many runs in tables and plots."),
    "check": ("check:check", "Compare", "Run recorded configurations again and compare the numbers."),
    "evaluate": ("evaluate:evaluate", "Compare", "Score motions that any program made against true ones."),
    "detect": ("detect:detect", "Data", "Detect people's joints in videos."),
    "import": ("import_motions:import_motions", "Data", "Import motion files into a motion library."),
    "export": ("export:export_recording", "Data", "Export the motion of a recording, or a video with the skeleton."),
    "annotate": ("annotate:annotate", "Data", "Annotate joints in a video by hand."),
    "calibrate": ("calibrate:app", "Data", "Calibrate cameras by a checkerboard, or by a person's height."),
    "check-calibration": ("check_calibration:check_of_dataset", "Data", "Check whether a calibration fits."),
}
"""Module and function (or typer application), panel of the help, and summary of each subcommand."""


class _Commands(TyperGroup):
    """Subcommands that are imported when they are called; the help and a mistyped name import none."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, *rest = args
        if name not in COMMANDS:
            ctx.fail(_unknown(args))
        if ctx.resilient_parsing and name == "run":  # a shell waits for the completion of a word
            from workbench.cli.completion import app as completed

            return name, get_command(completed), rest
        return name, _loaded(name), rest

    def invoke(self, ctx: Any) -> Any:
        """Call a subcommand and return its exit code; an expected error is printed as one message."""
        try:
            code = super().invoke(ctx)
            sys.stdout.flush()  # here, as typer handles a closed pipe
            return code
        except (Exception, KeyboardInterrupt) as error:
            if isinstance(error, (typer.Exit, BrokenPipeError)) or _usage_error(error) is not None:
                raise  # typer's own
            from workbench.cli.error_messages import report_error

            if (code := report_error(error)) is None:
                raise
            return code


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"workbench {__version__}")
        raise typer.Exit


app = typer.Typer(cls=_Commands, context_settings={"ignore_unknown_options": True})


@app.callback()
def _workbench(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Track articulated people in 3-D.

    `workbench run` tracks a walking person; `workbench COMMAND --help` explains a command.
    """


for _name, (_, _panel, _summary) in COMMANDS.items():
    app.command(_name, help=_summary, rich_help_panel=_panel)(lambda: None)  # for the help; see `_loaded`


def main(argv: Sequence[str] | None = None) -> int:
    """Run `workbench` with these arguments, by default the command line's.

    Returns 0 for success, 2 for bad input, 1 for any other failure, 128 + n for an interruption by signal n.
    """
    arguments = ["--help" if text == "-h" else text for text in (sys.argv[1:] if argv is None else argv)]
    try:
        return get_command(app).main(arguments or ["--help"], "workbench", standalone_mode=False) or 0
    except Exception as error:
        if (message := _usage_error(error)) is None:
            raise
        print(message, file=sys.stderr)
        return 2


def _usage_error(error: BaseException) -> str | None:
    """Return the message of an error in an option or argument; None for any other error."""
    message = getattr(error, "format_message", None)  # older versions of typer export no common class of these errors
    context = getattr(error, "ctx", None)
    return None if message is None else f"{context.command_path if context else 'workbench'}: {message()}"


def _unknown(words: Sequence[str]) -> str:
    """Return the message for a first word that is no subcommand, with similar commands."""
    from workbench.experiment.config.options import options

    first = words[0]
    if "=" in first or first.startswith("-"):
        return f"expected a command before {first!r}; did you mean: {join(['workbench', 'run', *words])}"
    near = get_close_matches(first, COMMANDS, n=2)
    near = near or [f"run experiment={name}" for name in get_close_matches(first, options("experiment"), n=1)]
    if not near:
        return f"there is no command {first!r}; workbench --help lists them"
    return f"there is no command {first!r}; did you mean: {' or '.join(f'workbench {command}' for command in near)}"


def _loaded(name: str) -> Any:
    """Import a subcommand: a typer application, or a function with typer's annotations."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    with ending_at_once():
        application = getattr(import_module(f"workbench.cli.{module}"), attribute)
    if not isinstance(application, typer.Typer):
        function, application = application, typer.Typer(add_completion=False)
        application.command()(function)
    return _with_examples_last(get_command(application))


def _with_examples_last(command: Any) -> Any:
    """Move the examples of the docstrings of a command and its subcommands to the end of their help."""
    for subcommand in getattr(command, "commands", {}).values():
        _with_examples_last(subcommand)
    text, _, examples = inspect.cleandoc(command.help or "").partition("Examples:\n")
    if examples:
        command.help, command.epilog = text.rstrip("\b\n "), f"Examples:\n{examples}"
    return command
