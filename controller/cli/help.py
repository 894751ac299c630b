"""``haptic-wall help``: prints the same as ``--help``."""

from __future__ import annotations

import click

from haptic_wall.controller.cli.options import answer


@click.command()
@click.argument("command_name", metavar="[COMMAND]", required=False)
@click.pass_context
def command(context: click.Context, command_name: str | None) -> None:
    """Show the help of COMMAND, or of the program."""
    program = context.parent
    assert program is not None and isinstance(program.command, click.Group)
    if command_name is None:
        answer(program.get_help())
        return
    wanted = program.command.get_command(program, command_name)
    assert wanted is not None  # else an error was raised
    with click.Context(wanted, info_name=command_name, parent=program) as inner:
        answer(inner.get_help())
