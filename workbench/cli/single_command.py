"""One typer function run as a command of its own, `python -m workbench.cli.NAME`."""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import typer

from workbench.cli.error_messages import report_error
from workbench.utils.signals import interruptible


def run_command(function: Callable[..., None], name: str, argv: Sequence[str] | None) -> int:
    """Return the exit code of a command: 2 for wrong input, which is printed as one sentence, 128 + n by signal n."""

    @wraps(function)
    def called(*arguments: Any, **options: Any) -> None:
        try:
            with interruptible():
                function(*arguments, **options)
        except (Exception, KeyboardInterrupt) as error:
            if isinstance(error, typer.Exit) or (code := report_error(error)) is None:
                raise
            raise typer.Exit(code) from None

    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command()(called)
    try:
        app(args=argv, prog_name=name)
    except SystemExit as end:
        return int(end.code or 0)
    return 0
