"""``truestand serve``: the operator page."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import QuietOption


class RoleName(StrEnum):
    """What a user may do."""

    OPERATOR = "operator"
    ENGINEER = "engineer"


StandFile = Annotated[Path, typer.Option("--stand", metavar="STAND.toml", help="The stand, with its [devices].")]


def serve(
    stand: StandFile = Path("stand.toml"),
    artefact: Annotated[
        Path | None,
        typer.Option(metavar="SHAFT.toml", help="The shaft; default: shaft.toml beside the stand."),
    ] = None,
    store: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The results store; default: as stand.toml says.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to serve at; one that others reach needs users.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 8620,
    name: Annotated[
        list[str] | None,
        typer.Option("--name", metavar="NAME", help="A further host name that the page is reached under."),
    ] = None,
    proxy: Annotated[
        list[str] | None,
        typer.Option("--proxy", metavar="ADDRESS", help="A proxy that does https; its X-Forwarded- headers count."),
    ] = None,
    tls_certificate: Annotated[
        Path | None, typer.Option("--tls-certificate", metavar="PEM", help="Serve https with this certificate chain.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option("--tls-key", metavar="PEM", help="Its private key.")] = None,
    opcua: Annotated[
        str | None,
        typer.Option("--opcua", metavar="URL", help="Serve machines over OPC UA too: opc.tcp://127.0.0.1:4840"),
    ] = None,
    mqtt: Annotated[
        str | None, typer.Option("--mqtt", metavar="URL", help="Tell an MQTT broker: mqtt://user@host:1883/prefix")
    ] = None,
    mqtt_password_file: Annotated[
        Path | None,
        typer.Option(
            "--mqtt-password-file", metavar="FILE", help="The broker's password; default: $TRUESTAND_MQTT_PASSWORD."
        ),
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    add_user: Annotated[
        str | None, typer.Option("--add-user", metavar="NAME", help="Add a user, or change one; asks for a password.")
    ] = None,
    role: Annotated[RoleName, typer.Option(help="Of the user that is added.")] = RoleName.OPERATOR,
    remove_user: Annotated[str | None, typer.Option("--remove-user", metavar="NAME", help="Remove a user.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Serve the operator page of a stand until Ctrl-C; a job that runs then is aborted first.

    Example: truestand serve --stand stand.toml --open
    """
    kept = store or _store_of(stand)
    if add_user is not None or remove_user is not None:
        _change_users(kept, add_user, role, remove_user, quiet)
        return
    from truestand.core.errors import BadRecipe
    from truestand.files.recipes.recipes import read_stand
    from truestand.web.app_state import Settings, make_state
    from truestand.web.interfaces.startup import interface_settings, open_interfaces
    from truestand.web.serving import Binding
    from truestand.web.serving import serve as run

    if (tls_certificate is None) != (tls_key is None):
        raise BadRecipe("found one of --tls-certificate and --tls-key, need both")
    read_stand(stand)
    settings = Settings(stand.absolute(), (artefact or stand.parent / "shaft.toml").absolute(), kept.absolute())
    binding = Binding(host, port, tuple(name or ()), tuple(proxy or ()), tls_certificate, tls_key)
    page = make_state(settings)
    beside = open_interfaces(page, interface_settings(page, opcua, mqtt, mqtt_password_file))
    run(page, binding, lambda address: _told(stand, address, quiet), open_browser, beside)


def _store_of(stand: Path) -> Path:
    """As stand.toml says; beside it where it says nothing."""
    from truestand.files.recipes.recipes import read_store_folder

    return (read_store_folder(stand) if stand.is_file() else None) or stand.parent / "results"


def _told(stand: Path, address: str, quiet: bool) -> None:
    if not quiet:
        print(f"truestand: serving {stand} at {address}", flush=True)


def _change_users(store: Path, add: str | None, role: RoleName, remove: str | None, quiet: bool) -> None:
    """Write the file of users; a page that serves takes note by itself."""
    from truestand.core.errors import BadRecipe
    from truestand.web.authentication import make_user, read_users, users_path, write_users

    path = users_path(store.absolute())
    users = read_users(path)
    if remove is not None and users.pop(remove, None) is None:
        raise BadRecipe(f"found no user {remove!r}, need one of: {', '.join(users) or 'nobody yet'}")
    if add is not None:
        users[add] = make_user(add, role.value, _password(add))
    write_users(path, users)
    if not quiet:
        nobody = "no users, so that nobody may enter; add one, or remove this file to let in everyone on this machine"
        typer.echo(f"{path}: {', '.join(f'{u.name} ({u.role})' for u in users.values()) or nobody}")


def _password(name: str) -> str:
    """Typed twice on a terminal; one line of standard input elsewhere."""
    if sys.stdin.isatty():
        return str(typer.prompt(f"Password of {name}", hide_input=True, confirmation_prompt=True))
    return sys.stdin.readline().rstrip("\r\n")
