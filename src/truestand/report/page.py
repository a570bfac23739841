"""The HTML around every report: one file with its style inside, its head, figures with their captions."""

from collections.abc import Iterable
from html import escape
from importlib.resources import files

from truestand._version import __version__
from truestand.files.recipes.recipes import Company
from truestand.report.notation import prose

K_NOTE = '<p class="k">± <i>U</i>: expanded uncertainty, <i>k</i> = 2.</p>'


def page(title: str, parts: Iterable[str], note: str) -> str:
    """The whole file. ``note`` stands at its foot."""
    style = files("truestand.report").joinpath("style.css").read_text(encoding="utf-8")
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head><body>{''.join(parts)}"
        f"<footer>truestand {__version__}. {note}</footer></body></html>\n"
    )


def head(over: str, title: str, facts: Iterable[str], company: Company | None = None) -> str:
    """What a report is, of what, and the facts in a line; the company's name and logo above."""
    return (
        f'<header>{_letterhead(company)}<p class="over">{escape(over)}</p><h1>{escape(title)}</h1>'
        f'<p class="facts">{escape(" · ".join(facts))}</p></header>'
    )


def _letterhead(company: Company | None) -> str:
    if company is None:
        return ""
    logo = "" if company.logo is None else f'<img src="{company.logo}" alt="">'
    address = "<br>".join(escape(line) for line in company.address.splitlines() if line.strip())
    return f'<div class="company">{logo}<div><b>{escape(company.name)}</b><div>{address}</div></div></div>'


def stamp(kind: str, mark: str, word: str, meaning: str, reasons: Iterable[str] = ()) -> str:
    """The verdict in large type; its mark has a shape of its own, so that it is told apart without colour."""
    items = "".join(f"<li>{prose(r)}</li>" for r in reasons)
    return (
        f'<section class="stamp {kind}"><div class="mark">{mark}</div><div><div class="word">{word}</div>'
        f"<div>{meaning}</div></div></section>" + (f'<ul class="reasons">{items}</ul>' if items else "")
    )


def not_measured(title: str, items: Iterable[str]) -> str:
    """What could not be measured: the first thing a reader should know. The items are HTML; empty where none."""
    listed = "".join(f"<li>{item}</li>" for item in items)
    return f'<div class="unseen"><h3>{title}</h3><ul>{listed}</ul></div>' if listed else ""


def framed(svg: str, caption: str) -> str:
    """A figure with its caption, which is HTML."""
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>"
