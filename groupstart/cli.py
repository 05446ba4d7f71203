"""One command, ``groupstart``, with verbs. Exit status 0 good, 1 refused or bad verdict, 2 fault of the environment.

A verb's module is imported when the verb is called, so ``groupstart --help`` costs no more than click itself.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import sys
from collections.abc import Sequence

import click

from groupstart.compiled import FINDER
from groupstart.exits import EXIT_FAULT, VerbError

VERBS: dict[str, str] = {
    "check": "Parse and interpret a program; print every error with its place.",
    "canon": "Print a program's canonical commands as text.",
    "plan": "Plan a program's motion; print the report, write plan.npz.",
    "preview": "Draw the path of a program.",
    "verify": "Run a program on the simulated machine and judge it.",
    "estimate": "Tell how long programs take, by operation and tool.",
    "diff": "Compare the motion of two programs or two machines.",
    "regress": "Run a suite of jobs on machines against its baselines.",
    "export": "Write a plan or a trace in the formats of other tools.",
    "run": "Run a program: on the simulated machine, or on a port.",
    "home": "Send axes to their machine zero.",
    "jog": "Move axes by a distance.",
    "mdi": "Run one line of G-code.",
    "scan": "Say who is on the bus.",
    "probe-latch": "Measure what a PIC-STEP does where its data sheet is silent.",
    "calibrate": "Measure the crystal of each module.",
    "tune": "Find the gains of a PIC-SERVO axis.",
    "reset": "Put every module back to its power-up state.",
    "sim": "Serve a simulated machine on a pseudo-terminal.",
    "machines": "List, show and check machine files.",
    "dump": "Decode captured bus bytes into packets.",
}
"""Verb: its one line of help. ``groupstart.verbs.<verb>`` (``_`` for ``-``) has a click command ``command``."""

AT_ONCE = ("dump", "scan")
"""Verbs that have too little to do for compiled code to be worth loading."""


class LazyGroup(click.Group):
    """A click group that imports the module of a verb only when that verb is wanted."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Verbs in the order of the work."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the verb's module."""
        if cmd_name not in VERBS:
            return None
        if cmd_name in AT_ONCE:
            FINDER.turn_off()
        command: click.Command = importlib.import_module(f"groupstart.verbs.{cmd_name.replace('-', '_')}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs without importing them."""
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))


def _print_version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if not value:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        click.echo(version("groupstart"))
    except PackageNotFoundError:
        click.echo("0 (not installed)")
    ctx.exit()


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_version, help="Print it.")
def cli() -> None:
    """G-code in, coordinated motion of NMC chips out, checked first on a lockstep simulator."""


QUICKLY = {"OPENBLAS_NUM_THREADS": "1", "NUMPY_MADVISE_HUGEPAGE": "0", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
"""Environment variables of libraries that are imported later; who has set them otherwise keeps that."""


def _begin_quickly() -> None:
    """Settings of the whole process, a fifth of the time that a short program takes.

    The collector looks at everything that imports make over and over, and finds nothing; the linear algebra here is
    of a few rows, but its library keeps a thread spinning on every core; arrays live shortly, and huge pages for them
    are zeroed whole each time; pydantic looks for plug-ins in all that is installed.
    """
    gc.set_threshold(100_000, 20, 50)
    atexit.register(gc.freeze)  # what is left at the end goes with the process
    for name, value in QUICKLY.items():
        os.environ.setdefault(name, value)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit status; no traceback for what the user can cure."""
    _begin_quickly()
    try:
        status = cli.main(arguments, prog_name="groupstart", standalone_mode=False)
    except VerbError as error:
        if error.text:
            click.echo(error.text, err=True)
        status = error.status
    except click.ClickException as error:
        error.show()
        status = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("interrupted", err=True)
        status = EXIT_FAULT
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has left; nobody is there to tell
        status = EXIT_FAULT
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        click.echo(f"{place}{error.strerror or error}", err=True)
        status = EXIT_FAULT
    sys.exit(status if isinstance(status, int) else 0)
