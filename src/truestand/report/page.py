"""The HTML around every report: one file with its style inside, its head, figures with their captions."""

from collections.abc import Iterable
from html import escape
from importlib.resources import files
from math import degrees

from truestand._version import __version__
from truestand.core.assumptions import Assumption
from truestand.files.recipes.recipes import Company

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
    items = "".join(f"<li>{escape(r)}</li>" for r in reasons)
    return (
        f'<section class="stamp {kind}"><div class="mark">{mark}</div><div><div class="word">{word}</div>'
        f"<div>{meaning}</div></div></section>" + (f'<ul class="reasons">{items}</ul>' if items else "")
    )


def not_measured(title: str, items: Iterable[str]) -> str:
    """What could not be measured: the first thing a reader should know. The items are HTML; empty where none."""
    listed = "".join(f"<li>{item}</li>" for item in items)
    return f'<div class="unseen"><h3>{title}</h3><ul>{listed}</ul></div>' if listed else ""


def assumed(assumptions: Iterable[Assumption]) -> str:
    """What nobody stated and the result rests on, with its heading; empty where all was stated."""
    rows = "".join(
        f'<tr><th>{escape(a.name)}</th><td class="n">{_value_text(a)}</td><td>{escape(a.source)}</td></tr>'
        for a in assumptions
    )
    return (
        "<h2>What was assumed</h2><p>Nobody stated these numbers (± U, k = 2). Better ones make every U smaller.</p>"
        f'<table class="assumed"><tbody>{rows}</tbody></table>'
        if rows
        else ""
    )


def _value_text(a: Assumption) -> str:
    """The value in um, arc seconds or ppm where mm, rad or a plain share would read badly."""
    scale, unit = {"mm": (1e3, "um"), "rad": (degrees(3600), "″"), "1": (1e6, "ppm")}.get(a.unit, (1.0, a.unit))
    return f"{'' if a.constant else '± '}{scale * a.value:.3g} {unit}"


def framed(svg: str, caption: str) -> str:
    """A figure with its caption, which is HTML."""
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>"
