"""The door: every command is registered here, every expected error is caught here and told in one line."""

import os
import sys
from typing import Annotated, NoReturn

import typer

from truestand._version import __version__
from truestand.cli import (
    acquire,
    audit,
    calibrate,
    certificate,
    compare,
    demo,
    files,
    form,
    history,
    identify,
    info,
    init,
    inspect,
    recover,
    roll,
    schema,
    serve,
    simulate,
    simulate_stand,
    store,
    verify,
)
from truestand.cli.exit_codes import DONE, WRONG_USE
from truestand.core.errors import TruestandError

app = typer.Typer(
    name="truestand",
    help="Calibrate a rotary laser inspection stand from one scan, and know how well.",
    epilog="New here? Run: truestand demo",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.command("demo")(demo.demo)
app.command("init")(init.init)
app.command("simulate")(simulate.simulate)
app.command("import")(files.import_scan)
app.command("info")(info.info)
app.command("calibrate")(calibrate.calibrate)
app.command("verify")(verify.verify)
app.command("roll")(roll.roll)
app.command("inspect")(inspect.inspect)
app.command("identify")(identify.identify)
app.command("form")(form.form)
app.command("compare")(compare.compare)
app.command("acquire")(acquire.acquire)
app.command("recover")(recover.recover)
app.add_typer(simulate_stand.app, name="stand")
app.command("history")(history.history)
app.command("audit")(audit.audit)
app.add_typer(store.app, name="store")
app.command("serve")(serve.serve)
app.command("certificate")(certificate.certificate)
app.command("schema")(schema.schema)


def _version(show: bool) -> None:
    if show:
        typer.echo(f"truestand {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Calibrate a rotary laser inspection stand from one scan, and know how well."""


def main() -> NoReturn:
    """Run the command line: 0 done or holds, 1 does not hold, 2 wrong use or input, 3 undecided, 130 interrupted."""
    _one_thread()
    try:
        app()
    except TruestandError as wrong:
        _stop(str(wrong))
    except OSError as wrong:
        where = f"{wrong.filename}: " if wrong.filename else ""
        _stop(f"{where}{wrong.strerror or wrong}; check the path, permissions and free space")
    except MemoryError:
        _stop("out of memory; close other programs or use the native format (truestand import)")
    sys.exit(DONE)


def _one_thread() -> None:
    """Keep linear algebra on one thread, before numpy is loaded: small matrices gain nothing, waiting threads cost.

    It also makes the last digit of a record the same on every machine of one kind.
    """
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _stop(message: str) -> NoReturn:
    print(f"truestand: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(WRONG_USE)
