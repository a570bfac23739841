"""``truestand serve``: the operator page."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import DevicesOption, QuietOption
from truestand.core.errors import BadRecipe
from truestand.files.recipes.recipes import read_stand, read_store_folder
from truestand.web.authentication import Role, make_user, read_users, users_path, write_users


def serve(
    stand: DevicesOption = Path("stand.toml"),
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
    role: Annotated[Role, typer.Option(help="Of the user that is added.")] = "operator",
    remove_user: Annotated[str | None, typer.Option("--remove-user", metavar="NAME", help="Remove a user.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Serve the operator page of a stand until Ctrl-C; a job that runs then is aborted first.

    Example: truestand serve --stand stand.toml --open
    """
    folder = store or _store_folder(stand)
    if add_user is not None or remove_user is not None:
        _change_users(folder, add_user, role, remove_user, quiet)
        return
    from truestand.web.app_state import Settings, make_state
    from truestand.web.interfaces.startup import interface_settings, open_interfaces
    from truestand.web.serving import Binding
    from truestand.web.serving import serve as run

    if (tls_certificate is None) != (tls_key is None):
        raise BadRecipe("found one of --tls-certificate and --tls-key, need both")
    read_stand(stand)
    settings = Settings(stand.absolute(), (artefact or stand.parent / "shaft.toml").absolute(), folder.absolute())
    binding = Binding(host, port, tuple(name or ()), tuple(proxy or ()), tls_certificate, tls_key)
    state = make_state(settings)
    beside = open_interfaces(state, interface_settings(state, opcua, mqtt, mqtt_password_file))
    run(state, binding, lambda address: _print_address(stand, address, quiet), open_browser, beside)


def _store_folder(stand: Path) -> Path:
    """As stand.toml says; beside it where it says nothing."""
    return (read_store_folder(stand) if stand.is_file() else None) or stand.parent / "results"


def _print_address(stand: Path, address: str, quiet: bool) -> None:
    if not quiet:
        print(f"truestand: serving {stand} at {address}", flush=True)


def _change_users(store: Path, add: str | None, role: Role, remove: str | None, quiet: bool) -> None:
    """Write the file of users; a page that serves takes note by itself."""
    path = users_path(store.absolute())
    users = read_users(path)
    if remove is not None and users.pop(remove, None) is None:
        raise BadRecipe(f"found no user {remove!r}, need one of: {', '.join(users) or 'nobody yet'}")
    if add is not None:
        users[add] = make_user(add, role, _password(add))
    write_users(path, users)
    if not quiet:
        nobody = "no users, so that nobody may enter; add one, or remove this file to let in everyone on this machine"
        typer.echo(f"{path}: {', '.join(f'{u.name} ({u.role})' for u in users.values()) or nobody}")


def _password(name: str) -> str:
    """Typed twice on a terminal; one line of standard input elsewhere."""
    if sys.stdin.isatty():
        return str(typer.prompt(f"Password of {name}", hide_input=True, confirmation_prompt=True))
    return sys.stdin.readline().rstrip("\r\n")
