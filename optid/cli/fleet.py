"""`optid fleet`: many rigs and recordings, here or on a cluster; its progress and its report."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.cli.common import OUT, RATE, deliver, progress, rate_asked, results_folder, say_next, write_json
from optid.cli.options import everywhere
from optid.errors import InputError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from optid.fleet.cluster import ClusterExecutor
    from optid.results.fleet import FleetResult

_FOLDER = click.argument("folder", metavar="DIR")


class _Files(click.Group):
    """Lets `optid fleet FILE` mean `optid fleet run FILE`."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the first word names; any other word names a fleet file."""
        return super().resolve_command(ctx, args if args[0] in self.commands else ["run", *args])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Options may precede the file, as with any other command."""
        if args and args[0].startswith("-") and args[0] not in ("-h", "--help"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Files)
def fleet() -> None:
    """Run the rows of a fleet file that are missing or changed, and report on the whole fleet.

    \b
      optid fleet fleet.toml --out out/fleet                        all cores here, one thread each
      optid fleet fleet.toml --out out/fleet --on tcp://head:8786   a Dask cluster
      optid fleet status out/fleet
      optid fleet report out/fleet
      optid fleet test RIG RECORDING... --out out/test              one rig, one night's recordings
    """


@click.command("run")
@click.argument("file", metavar="FLEET.toml")
@OUT
@click.option(
    "--on", "address", metavar="ADDRESS", help="Address of a Dask scheduler; jobs run on its workers."
)
@click.option(
    "--tls-ca",
    metavar="FILE",
    help="Certificate authority of the cluster (PEM file); with --tls-cert and --tls-key.",
)
@click.option("--tls-cert", metavar="FILE", help="Certificate of this client (PEM file).")
@click.option("--tls-key", metavar="FILE", help="Private key of this client (PEM file).")
@click.pass_context
def run_fleet(context: click.Context, /, file: str, out: str, address: str | None, **tls: str | None) -> None:
    """Run the rows of a fleet file that are missing or changed, and report on the whole fleet.

    Each row is a process with one thread, unless its table sets more; --threads limits how many run here at once.
    Exit status 1 if any row failed; the other rows run all the same.
    """
    folder = results_folder(out)

    from optid.fleet.fleet import run
    from optid.fleet.fleetfile import read_fleet

    asked = read_fleet(file)
    with _executor(address, tls) as executor, progress("fleet") as show:
        result = run(asked, folder, executor=executor, progress=show)
    _tell(result, folder, out)
    if result.failed:
        context.exit(1)


@click.command("status")
@_FOLDER
@click.option("--out", metavar="DIR", help="Folder for status.json; made if absent.")
def status_of(folder: str, out: str | None) -> None:
    """Show the progress of a fleet: rows done, running, failed and why, and the expected end."""
    from optid.fleet.progress import status

    found = status(folder)
    click.echo(found.summary())
    if out is not None:
        content = {
            "schema": "optid.fleet-status/1",
            "rows": found.rows,
            "outcomes": dict(found.outcomes),
            "running": list(found.running),
            "failed": [dict(zip(("name", "outcome", "said"), one, strict=True)) for one in found.failed],
            "seconds_left": found.left if found.left >= 0.0 else None,
        }
        deliver(results_folder(out), lambda place: write_json(place / "status.json", content))
    say_next("fleet", "report", folder)


@click.command("report")
@_FOLDER
@click.option("--out", metavar="DIR", help="Folder for the report; the fleet's own by default.")
def report_of(folder: str, out: str | None) -> None:
    """Write fleet.json, fleet.parquet and report.html of the rows finished so far."""
    from optid.fleet.fleet import conclude

    place = results_folder(folder if out is None else out)
    _tell(conclude(folder), place, folder if out is None else out)


@click.command("test")
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option(
    "--watch",
    multiple=True,
    metavar="EFFECT",
    help="Effect whose size is estimated as well; may be repeated.",
)
@RATE
@OUT
def test_night(rig: str, recordings: tuple[str, ...], watch: tuple[str, ...], out: str) -> None:
    """Estimate what may have changed in a fitted rig from one night's recordings, in seconds.

    Whether it changed is decided by the fleet's report, which compares the rig's nights.
    """
    folder = results_folder(out)

    from optid.fleet.fleetfile import WATCHED
    from optid.fleet.night import FILE, night_test

    with progress("testing") as show:
        found = night_test(rig, recordings, watch=watch or WATCHED, rate=rate_asked(), progress=show)
    deliver(folder, lambda place: write_json(place / FILE, found))
    for name, one in found["quantities"].items():
        spread = "" if one["sd"] is None else f" +- {1.96 * one['sd']:.2g}"
        unit = "" if one["unit"] == "1" else f" {one['unit']}"
        click.echo(f"{name.replace('_', ' '):40} {one['value']:.5g}{spread}{unit}")
    click.echo(f"written to {out}: {FILE}")
    say_next("diagnose", rig, *recordings, "--holdout", "OTHER", "--out", "DIR")


def _tell(result: FleetResult, folder: Path, out: str) -> None:
    deliver(folder, result.write)
    click.echo(result.summary())
    click.echo(f"written to {out}: {', '.join(result.written)}")
    if result.failed:
        say_next("fleet", "status", out)
    elif result.told:
        say_next("diagnose", "RIG", "RECORDING", "--holdout", "OTHER", "--out", "DIR")
    else:
        say_next("fleet", "FLEET.toml", "--out", out)


def _executor(address: str | None, tls: dict[str, Any]) -> AbstractContextManager[ClusterExecutor | None]:
    if address is None:
        return nullcontext()
    from optid.fleet.cluster import Certificates, connected, is_open

    given = [tls[name] for name in ("tls_ca", "tls_cert", "tls_key")]
    if any(given) and not all(given):
        raise InputError(
            "only some are given", where="--tls-ca, --tls-cert, --tls-key", expected="all three, or none"
        )
    if is_open(address):
        click.echo(
            f"optid: {address} is not encrypted: whoever can reach it can run programs as you; "
            "keep it behind a firewall, or use tls:// with --tls-ca, --tls-cert and --tls-key",
            err=True,
        )
    return connected(address, Certificates(*given) if all(given) else None)


for command in (run_fleet, status_of, report_of, test_night):
    fleet.add_command(everywhere(command))
