"""`convoy channel …`."""

import click

from scenarios.cli.channel.figure import figure


@click.group(
    epilog="""\b
Examples:
  convoy channel figure --quick
"""
)
def channel() -> None:
    """Look at channels: what they cost a convoy."""


channel.add_command(figure)
