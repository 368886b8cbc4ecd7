"""The command line: reads arguments, calls one job, prints a short summary and an exit status.

0 done; 1 the job failed, and why; 2 the call or an input file is wrong. Each command has its own file; slow imports
stay inside the commands, so that help appears at once.
"""

from __future__ import annotations

import importlib.metadata
import os
import sys
import warnings
from typing import Any, NoReturn

import click

from optid.cli.check import check
from optid.cli.diagnose import diagnose
from optid.cli.example import example
from optid.cli.fit import fit
from optid.cli.fleet import fleet
from optid.cli.identify import identify
from optid.cli.live import live
from optid.cli.options import everywhere
from optid.cli.plan import plan
from optid.cli.run import Run, Stopped, begun, ended_at_once
from optid.cli.simulate import simulate
from optid.cli.tune import tune
from optid.errors import InputError, JobError, one_line

# Threads of the linear algebra: one, because its matrices are small, --threads limits all cores, and sums in another
# order lead a search to another end.
BLAS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
HELP = """From recordings of a servo axis to a model. To start: optid example DIR

\b
  optid check bench.toml run1.csv
      Are the files valid, and are the data good enough for identification?
  optid simulate bench.toml run1.csv --out out/sim
      How well do the rig file's values predict the recording?
  optid fit bench.toml run1.csv run2.csv --holdout run3.csv --out out/fit
      Fit the parameters of the [fit] table and judge them on a recording that was held out.
  optid diagnose bench.toml run1.csv run2.csv --holdout run3.csv --out out/diagnosis
      Which physics does the model lack, where, how large is it, and does it improve held-out predictions?
  optid plan bench.toml --rivals valve_lag,input_delay --out out/plan
      Which experiment distinguishes these effects best? Writes its reference and the predicted outcome.
  optid live bench.toml --driver simulated --out out/live
      Control a rig while its model runs in parallel: read, identify, simulate, control, log.
  optid identify run1.csv --rig bench.toml --out out/armax
      ARMAX models, checks of each model, and a table of their prediction errors.
  optid fleet fleet.toml --out out/fleet
      Run any of these for many rigs and recordings, and list the rigs that changed or differ.
  optid tune out/armax/armax.json --rig out/fit/rig.toml --out out/tune
      PID gains by direct ITAE optimisation under the actuator's limits.

Exit status: 0 done, 1 the job failed, 2 a wrong call or input file.
"""


class OneLine(click.Group):
    """A group whose every failure is one line on stderr and an exit status."""

    def main(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Run a command and leave with its exit status; `OPTID_TRACEBACK=1` lets exceptions through."""
        kwargs["standalone_mode"] = False
        called = args[0] if args else kwargs.get("args")
        with begun(sys.argv[1:] if called is None else called) as run:
            self._go(run, *args, **kwargs)

    def _go(self, run: Run, *args: Any, **kwargs: Any) -> NoReturn:
        try:
            status = super().main(*args, **kwargs)
        except click.ClickException as error:
            _leave(f"{error.format_message()} (optid --help shows how to call it)", 2)
        except (click.Abort, KeyboardInterrupt) as error:
            stopped = error if isinstance(error, Stopped) else error.__cause__  # click wraps it
            how = f" by {stopped.args[0]}" if isinstance(stopped, Stopped) else ""
            what = "nothing was written" if run.delivered is None else f"the results are in {run.delivered}"
            _leave(f"interrupted{how}; {what}", 1)
        except BrokenPipeError:
            sys.stdout = None  # the reader of the pipe has gone: nobody reads more output
            sys.exit(1)
        except Exception as error:
            if os.environ.get("OPTID_TRACEBACK") == "1":
                raise
            _leave(*_in_words(error))
        sys.exit(status if isinstance(status, int) else 0)


def _in_words(error: Exception) -> tuple[str, int]:
    if isinstance(error, InputError):
        return str(error), 2
    if isinstance(error, JobError):
        return str(error), 1
    what = f"{type(error).__name__}: {error}"
    return f"this is a bug in optid, please report it: {what} (OPTID_TRACEBACK=1 shows where)", 1


def _leave(message: str, status: int) -> NoReturn:
    click.echo("optid: " + one_line(message), err=True)
    sys.exit(status)


@click.group(
    cls=OneLine,
    invoke_without_command=True,
    help=HELP,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(importlib.metadata.version("optid"), prog_name="optid")
@click.pass_context
def cli(context: click.Context) -> None:
    """See HELP."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


for command in (example, check, simulate, fit, diagnose, plan, live, identify, tune):
    cli.add_command(everywhere(command))
cli.add_command(fleet)


def main() -> None:
    """Entry point of the `optid` script."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # warnings of libraries mean nothing to the user of a command
    for name in BLAS:  # before NumPy is imported
        os.environ.setdefault(name, "1")
    with ended_at_once():
        cli()
