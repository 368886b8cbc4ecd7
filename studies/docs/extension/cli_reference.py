"""The command line's reference, from the parsers themselves."""

from __future__ import annotations

import inspect

import click

from optid.cli import cli

HEAD = """# Command line

This page is generated from the parsers of `optid`: it is what `optid COMMAND --help` prints. What each command
writes, and the meaning of the exit status, is described in [what the commands write](../../reference/commands.md).
"""


def pages() -> dict[str, str]:
    """File name -> text."""
    parts = [HEAD]
    for name, command in _commands(cli):
        context = click.Context(command, info_name=f"optid {name}")
        usage = " ".join(command.collect_usage_pieces(context))
        parts.append(
            f"\n## optid {name}\n\n{inspect.cleandoc(command.help or '')}\n\n```text\noptid {name} {usage}\n```\n\n"
        )
        options = [
            record
            for parameter in command.get_params(context)
            if isinstance(parameter, click.Option) and (record := parameter.get_help_record(context))
        ]
        parts.append("| option | does |\n|---|---|\n")
        parts += [f"| `{_cell(option)}` | {_cell(words)} |\n" for option, words in options]
    return {"index.md": "".join(parts)}


def _commands(group: click.Group, before: str = "") -> list[tuple[str, click.Command]]:
    """Every command, those of groups within groups as well."""
    found: list[tuple[str, click.Command]] = []
    for name, command in group.commands.items():
        full = f"{before}{name}"
        found += _commands(command, f"{full} ") if isinstance(command, click.Group) else [(full, command)]
    return found


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
