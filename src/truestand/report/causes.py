"""What makes U and what was assumed, each with how to do better: two tables, and a line for the terminal."""

import re
from collections.abc import Iterable, Sequence
from html import escape
from math import degrees

from truestand.core.assumptions import Assumption
from truestand.report.inspection_tables import table
from truestand.report.notation import NONE, prose
from truestand.uncertainty.causes import Cause

NO_WAY = "no recipe states it"
KEYS = re.compile(r"--\S+ [\d,]+|\[\[?\w+\]\]?|\w+\.toml|\b[A-Za-z]+_\w+")
"""What one types: options, tables, files and keys."""
KNOWN = {"stated": "stated", "measured": "as the scan shows it", "calibrated": "from the calibration"}
LARGER = {"mm": (1.0, " mm"), "rad": (degrees(1), "°")}
"""Units for what would be a thousand of the smaller ones."""


def most_of_u(causes: Iterable[Cause]) -> str:
    """Which inputs make most of U and how to make it smaller, with its heading; empty where nothing has a U.

    The quantities' names are HTML.
    """
    rows = "".join(
        f"<tr><th>{escape(c.name)}<small>{_known(c)}</small></th><td>{_shares(c)}</td>"
        f"<td>{_text(c.better) or (NO_WAY if c.known == 'assumed' else NONE)}</td></tr>"
        for c in causes
    )
    intro = (
        "<h2>What makes U, and how to make it smaller</h2><p>The inputs that make most of <i>U</i>, by their share of "
        "<i>U</i>². Half of an input that makes 100 % halves <i>U</i>; half of one that makes 50 % takes a fifth "
        "off.</p>"
    )
    head = "<tr><th>input</th><th>share of <i>U</i>²</th><th>what makes it smaller</th></tr>"
    return intro + table(head, rows, "inputs") if rows else ""


def assumed(assumptions: Iterable[Assumption]) -> str:
    """What nobody stated and the result rests on, with its heading; empty where all was stated."""
    rows = "".join(
        f'<tr><th>{escape(a.name)}</th><td class="n">{_value_text(a)}</td><td>{_text(a.source)}</td>'
        f"<td>{_text(a.key) or NONE}</td></tr>"
        for a in assumptions
    )
    intro = "<h2>What was assumed</h2><p>Nobody stated these numbers (± <i>U</i>, k = 2).</p>"
    head = '<tr><th>input</th><th class="n">taken as</th><th>because</th><th>what states it</th></tr>'
    return intro + table(head, rows, "inputs") if rows else ""


def cause_line(causes: Sequence[Cause]) -> str:
    """One line of plain text on the first input that was assumed and can be stated, or else on the first of all."""
    chosen = next((c for c in causes if c.known == "assumed" and c.better), causes[0] if causes else None)
    if chosen is None:
        return ""
    quantity, share = next(iter(chosen.shares.items()))
    first_way = chosen.better.partition(", or ")[0]
    known = KNOWN.get(chosen.known, chosen.known)
    return f"U² of {quantity} is {share:.0%} {chosen.name} ({known})" + (f": {first_way}" if first_way else "")


def _known(c: Cause) -> str:
    values = " and ".join(map(_value_text, c.assumed))
    return f"assumed: {values}" if c.known == "assumed" else KNOWN[c.known]


def _shares(c: Cause) -> str:
    shares = (f"{quantity} {100 * share:.0f}\N{NO-BREAK SPACE}%" for quantity, share in c.shares.items())
    return " ".join(f'<span class="share">{share}</span>' for share in shares)


def _text(plain: str) -> str:
    """Plain text as HTML, what one types marked as such."""
    return KEYS.sub(lambda found: f"<code>{found[0]}</code>", prose(plain))


def _value_text(a: Assumption) -> str:
    """The value in the unit that reads best: µm below a millimetre, arc seconds below a tenth of a degree, ppm."""
    scale, unit = {"mm": (1e3, " µm"), "rad": (degrees(3600), "″"), "1": (1e6, " ppm"), "1/K": (1e6, " ppm/K")}.get(
        a.unit, (1.0, f" {a.unit}")
    )
    if scale * a.value >= 1000 and a.unit in LARGER:
        scale, unit = LARGER[a.unit]
    return f"{'' if a.constant else '± '}{scale * a.value:.3g}{unit}"
