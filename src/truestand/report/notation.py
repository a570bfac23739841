"""How reports write numbers, symbols, units and verdicts, and what the symbols mean.

Numbers as a metrologist writes them: the uncertainty to two digits, the value to the same place.
"""

import re
from html import escape
from math import floor, isfinite, log10

from truestand.core.inspection import WORST, Characteristic, Verdict
from truestand.core.units import um

NONE = "\N{EN DASH}"
"""Where there is no number."""
MEANINGS = {
    "f_p": "largest single pitch deviation",
    "F_p": "total cumulative pitch deviation",
    "F_pk": "cumulative pitch deviation over k pitches",
    "f_u": "largest step between neighbouring pitches",
    "f_p_areal": "single pitch from whole flanks",
    "F_p_areal": "cumulative pitch from whole flanks",
    "F_r": "run-out of a ball in the tooth spaces",
    "F_alpha": "total profile deviation",
    "f_falpha": "profile form",
    "f_Halpha": "profile slope",
    "C_alpha": "profile crowning",
    "F_beta": "total helix deviation",
    "f_fbeta": "helix form",
    "f_Hbeta": "helix slope",
    "C_beta": "helix crowning",
    "F_alpha_areal": "total profile deviation, mean across the face",
    "f_falpha_areal": "profile form, mean across the face",
    "f_Halpha_areal": "profile slope, mean across the face",
    "F_beta_areal": "total helix deviation, mean up the profile",
    "f_fbeta_areal": "helix form, mean up the profile",
    "f_Hbeta_areal": "helix slope, mean up the profile",
    "F_alpha_worst": "total profile deviation, worst section of any tooth",
    "f_falpha_worst": "profile form, worst section of any tooth",
    "f_Halpha_worst": "profile slope, worst section of any tooth",
    "F_beta_worst": "total helix deviation, worst section of any tooth",
    "f_fbeta_worst": "helix form, worst section of any tooth",
    "f_Hbeta_worst": "helix slope, worst section of any tooth",
    "s": "tooth thickness on the measuring circle",
    "W_k": "span over k teeth",
    "M_d": "dimension over balls",
    "d_a": "tip diameter",
    "d_f": "root diameter",
    "d": "diameter",
    "roundness": "each circle against its own centre",
    "cylindricity": "all heights against one cylinder",
    "runout": "circular run-out about the datum axis",
    "total_runout": "total run-out about the datum axis",
    "deviation_p95": "95 % of the surface lies within ± this",
    "deviation_rms": "root mean square of the deviations",
    "deviation_max": "most material in excess",
    "deviation_min": "most material missing",
    "profile": "twice the largest deviation to either side",
}
OF_WHOLE_FLANKS = frozenset(name for name in MEANINGS if name.endswith((WORST, "alpha_areal", "beta_areal")))
"""For information, and left out where room is short."""
_NAMES = {
    "roundness": "Roundness",
    "cylindricity": "Cylindricity",
    "runout": "Run-out",
    "total_runout": "Total run-out",
    "deviation_p95": "Deviation, 95 %",
    "deviation_rms": "Deviation, rms",
    "deviation_max": "Largest deviation",
    "deviation_min": "Smallest deviation",
    "profile": "Profile of a surface",
}
VERDICTS: dict[Verdict, tuple[str, str]] = {
    "conforms": ("\N{CHECK MARK}", "conforms"),
    "does_not_conform": ("\N{MULTIPLICATION X}", "does not conform"),
    "undecided": ("?", "undecided"),
}
"""Mark and word: the mark tells verdicts apart without colour."""


def places(U: float | None) -> int:
    """Decimals that two digits of an uncertainty ask for, 0..6."""
    if U is None or not isfinite(U) or U <= 0:
        return 3
    return min(max(1 - floor(log10(U)), 0), 6)


def prose(plain: str) -> str:
    """Plain text as HTML, micrometres with their sign."""
    return re.sub(r"\bum\b", "µm", escape(plain))


def number(value: float | None, decimals: int = 3) -> str:
    """A number with fixed decimals; a dash where there is none. The minus sign is a real one."""
    if value is None or not isfinite(value):
        return NONE
    text = f"{value:,.{decimals}f}".replace(",", "\N{THIN SPACE}")
    return text.replace("-", "\N{MINUS SIGN}") if float(f"{value:.{decimals}f}") else text.replace("-", "")


def two_digits(value: float | None) -> str:
    """Two digits at least; of less than a hundred-thousandth as a power of ten. Empty where there is none."""
    if value is None:
        return ""
    return f"{value:.1e}" if 0 < abs(value) < 1e-5 else number(value, places(abs(value)))


def with_u(value: float | None, U: float | None) -> str:
    """``value ± U``, both to the uncertainty's second digit."""
    if value is None:
        return "not identifiable"
    if U is None:
        return number(value)
    decimals = places(U)
    return f"{number(value, decimals)} ± {number(U, decimals)}"


def _parts(name: str) -> tuple[str, str]:
    stem, _, below = name.partition("_")
    return stem, below.replace("alpha", "α").replace("beta", "β").replace("_", " ")


def symbol(name: str) -> str:
    """The name as HTML: f_Halpha with its index below."""
    if name in _NAMES:
        return _NAMES[name]
    if name not in MEANINGS:
        return escape(name)
    stem, below = _parts(name)
    return f"<i>{stem}</i><sub>{below}</sub>" if below else f"<i>{stem}</i>"


def drawn_symbol(name: str, limit: bool = False) -> str:
    """The name as matplotlib writes it; ``limit``: the tolerance of that name (a T behind the index)."""
    stem, below = _parts(name)
    return rf"${stem}_\mathrm{{{below}{'T' if limit else ''}}}$" if below else f"${stem}$"


def meaning(name: str) -> str:
    """A few words on it; empty where the name says it all."""
    return MEANINGS.get(name, "")


def unit(c: Characteristic) -> str:
    """Sizes are in mm, deviations in um."""
    return "mm" if c.size else "µm"


def shown(c: Characteristic, value: float) -> float:
    """A length (mm) in the unit of the characteristic."""
    return value if c.size else um(value)


def decimals(c: Characteristic) -> int:
    """Decimals that U asks for; no more than one would read."""
    if c.U is None:
        return 3 if c.size else 1
    return min(places(shown(c, c.U)), 4 if c.size else 2)


def value_text(c: Characteristic) -> str:
    """The value, to the second digit of U, ``≥`` before a lower bound; a dash where nothing was measured."""
    text = number(None if c.value is None else shown(c, c.value), decimals(c))
    return f"≥ {text}" if c.at_least else text


def u_text(c: Characteristic) -> str:
    """Expanded uncertainty; a dash behind a lower bound."""
    return number(None if c.U is None or c.at_least else shown(c, c.U), decimals(c))


def result_text(c: Characteristic) -> str:
    """The value and, where it is known and no lower bound, its expanded uncertainty."""
    return value_text(c) if c.U is None or c.at_least else f"{value_text(c)} ± {u_text(c)}"


def limit_text(c: Characteristic) -> str:
    """``12``, ``± 9.5`` or ``from … to``; a dash without limits."""
    if c.limits is None:
        return NONE
    low, high = (None if end is None else shown(c, end) for end in c.limits)
    if low is not None and high is not None:
        return f"± {_short(high)}" if abs(low + high) < 1e-9 else f"{_short(low)} … {_short(high)}"
    return f"≥ {_short(low)}" if high is None and low is not None else _short(high or 0.0)


def _short(value: float) -> str:
    return f"{round(value, 6):g}".replace("-", "\N{MINUS SIGN}")


def tolerance_share_text(c: Characteristic) -> str:
    """U against the width of the tolerance zone."""
    low, high = c.limits or (None, None)
    if c.U is None or c.at_least or high is None:
        return NONE
    width = high - (low or 0.0)
    return f"{100 * c.U / width:.0f} %" if width > 0 else NONE


def seen_text(c: Characteristic) -> str:
    """Coverage; what is only partly seen is said so."""
    text = f"{100 * c.coverage:.0f} %"
    return f"{text}<small>partial</small>" if c.status == "partial" else text


def verdict_text(c: Characteristic) -> str:
    """Mark and word of a line's verdict, as HTML; what can't be shown at all says so, a worst section where it is."""
    if c.name.endswith(WORST):
        return f"<small>{prose(c.reason or '')}</small>"
    if c.verdict is None:
        informative = c.standard is not None and "informative" in c.standard
        return '<span class="none">informative</span>' if informative else ""
    capable = "" if c.capable or c.at_least else "<small>not capable: U too large</small>"
    mark, word = VERDICTS[c.verdict]
    return f'<span class="v {c.verdict}"><b>{mark}</b>\N{NO-BREAK SPACE}{word}</span>{capable}'


def line_name(c: Characteristic) -> str:
    """Symbol, flank, tooth and section of a line, as HTML."""
    parts = [symbol(c.name), c.flank or "", f"tooth {c.tooth}" if c.tooth is not None else "", escape(c.section or "")]
    return " ".join(part for part in parts if part)
