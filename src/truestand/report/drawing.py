"""The style of all figures and their way to SVG; no global state. matplotlib is imported with the first figure."""

import io
import re
from functools import wraps
from math import floor, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from truestand.core.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INK, GREY, PALE = "#1f2933", "#7b8794", "#d5dbe1"
SURFACES = ("#1f6fb2", "#c8641b", "#3d8b5f", "#8a5a9e")
"""One colour a surface, told apart by the colour-blind too (with different lightness)."""
BEFORE, PAPER, EXACT, FAILS = "#7b8794", "#c8641b", "#1f6fb2", "#a8240b"
DIVERGING, SEQUENTIAL = "RdBu_r", "viridis"
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "truestand",
    "axes.unicode_minus": True,
}


def figure(width: float, height: float) -> "Figure":
    """An empty figure, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def single(width: float, height: float) -> "tuple[Figure, Axes]":
    """A figure, inches, with one pair of axes."""
    fig = figure(width, height)
    return fig, fig.add_subplot()


def svg(fig: "Figure") -> str:
    """The figure as an SVG element that scales with the page and repeats to the byte."""
    buffer = io.StringIO()
    fig.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, dpi=110)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    return re.sub(r'(<svg[^>]*?) width="[^"]*"| height="[^"]*pt"', r"\1", text, count=2).strip()


def styled(draw: Any) -> Any:
    """Decorate a function that draws, so that the style holds inside it and nowhere else."""

    @wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> str:
        import matplotlib as mpl

        with mpl.rc_context(STYLE):
            return svg(draw(*args, **kwargs))

    return drawn


def image(
    axes: "Axes", values: Array, extent: tuple[float, float, float, float], limits: tuple[float, float], cmap: str
) -> Any:
    """A dense map; what was not seen stays the page's pale grey."""
    axes.set_facecolor("#eceff2")
    return axes.imshow(
        np.ma.masked_invalid(values), aspect="auto", origin="lower", extent=extent, vmin=limits[0], vmax=limits[1],
        cmap=cmap, interpolation="nearest",
    )  # fmt: skip


def deviation_map(
    fig: "Figure", axes: "Axes", values: Array, extent: tuple[float, float, float, float], limit: float
) -> None:
    """Draw deviations (rows, columns) um with their colour bar, ``limit`` um to either side."""
    drawn = image(axes, values, extent, (-limit, limit), DIVERGING)
    fig.colorbar(drawn, ax=axes, label="µm", pad=0.01)


def polar_frame(axes: "Axes", title: str, reach: float) -> None:
    """A title and room for a polar plot of radius ``reach``, without axes."""
    axes.set(title=title, xlim=(-reach, reach), ylim=(-reach, reach))
    axes.set_axis_off()


def robust(*arrays: Array | None, share: float = 0.99) -> float:
    """Symmetric colour limit: the ``share`` quantile of the magnitudes drawn, at least 1e-6."""
    values = [np.abs(a[np.isfinite(a)]) for a in arrays if a is not None]
    joined = np.concatenate(values) if values else np.zeros(1)
    return max(float(np.quantile(joined, share)) if joined.size else 0.0, 1e-6)


def round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten, at most ``value``, which is positive."""
    power = 10.0 ** floor(log10(value))
    return max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= value * (1 + 1e-9))


def cell_edges(centres: Array) -> tuple[float, float]:
    """Where the first and last of equal cells with these centres begin and end."""
    half = (centres[1] - centres[0]) / 2 if centres.size > 1 else 0.5
    return float(centres[0] - half), float(centres[-1] + half)
