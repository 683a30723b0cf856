"""The program `workbench`: it imports the commands, during which SIGINT ends it at once."""

from workbench.utils.signals import ending_at_once


def main() -> int:
    """Run `workbench` with the command line's arguments and return its exit code, see `workbench.cli.main.main`."""
    with ending_at_once():
        from workbench.cli.main import main as run_command
    return run_command()
