"""Numbers as a metrologist writes them: the uncertainty to two digits, the value to the same place."""

from math import floor, isfinite, log10


def places(U: float | None) -> int:
    """Decimals that two digits of an uncertainty ask for, 0..6."""
    if U is None or not isfinite(U) or U <= 0:
        return 3
    return min(max(1 - floor(log10(U)), 0), 6)


def number(value: float | None, decimals: int = 3) -> str:
    """A number with fixed decimals; a dash where there is none. The minus sign is a real one."""
    if value is None or not isfinite(value):
        return "\N{EN DASH}"
    text = f"{value:,.{decimals}f}".replace(",", "\N{THIN SPACE}")
    return text.replace("-", "\N{MINUS SIGN}") if float(f"{value:.{decimals}f}") else text.replace("-", "")


def with_u(value: float | None, U: float | None) -> str:
    """``value ± U``, both to the uncertainty's second digit."""
    if value is None:
        return "not identifiable"
    if U is None:
        return number(value)
    decimals = places(U)
    return f"{number(value, decimals)} ± {number(U, decimals)}"
