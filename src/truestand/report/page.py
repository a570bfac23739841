"""The frame around every report: one HTML file with its style inside, figures with their captions."""

from collections.abc import Iterable
from html import escape
from importlib.resources import files

from truestand._version import __version__


def page(title: str, parts: Iterable[str], note: str, kind: str = "") -> str:
    """The whole file. ``note`` stands at its foot; ``kind``: a class of the body that the style knows."""
    style = files("truestand.report").joinpath("style.css").read_text(encoding="utf-8")
    body = f'<body class="{kind}">' if kind else "<body>"
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head>{body}{''.join(parts)}"
        f"<footer>truestand {__version__}. {note}</footer></body></html>\n"
    )


def framed(svg: str, caption: str) -> str:
    """A figure with its caption, which is HTML."""
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>"
