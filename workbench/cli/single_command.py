"""One typer function run as a command of its own, `python -m workbench.cli.NAME`."""

import os
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import typer
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from workbench.cli.error_messages import lines
from workbench.utils.errors import InputError, shortened
from workbench.utils.signals import Interrupted, interruptible


def run_command(function: Callable[..., None], name: str, argv: Sequence[str] | None) -> int:
    """Return the exit code of a command: 2 for wrong input, which is printed as one sentence, 128 + n by signal n."""

    @wraps(function)
    def called(*arguments: Any, **options: Any) -> None:
        try:
            with interruptible():
                function(*arguments, **options)
        except (InputError, HydraException, OmegaConfBaseException) as error:
            *there, sentence = lines(error)
            print("\n".join([*there, f"{name}: {shortened(sentence)}"]), file=sys.stderr)
            raise typer.Exit(2) from None
        except BrokenPipeError:  # the reader, such as `head`, has ended; nothing is left to flush at the exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(1) from None
        except Interrupted as error:
            print(f"{name}: interrupted by {error}", file=sys.stderr)
            raise typer.Exit(128 + error.number) from None

    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command()(called)
    try:
        app(args=argv, prog_name=name)
    except SystemExit as end:
        return int(end.code or 0)
    return 0
