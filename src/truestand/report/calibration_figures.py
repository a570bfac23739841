"""The figures of a calibration report. Each returns SVG text; lengths are mm inside, um on the axes."""

from math import degrees, tau

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from truestand.calibration.evidence import Evidence, FlatMap, Projection, Rolled
from truestand.core.calibration import Calibration, StaticProfile
from truestand.core.units import um
from truestand.report.drawing import (
    BEFORE,
    EXACT,
    GREY,
    INK,
    PALE,
    PAPER,
    SEQUENTIAL,
    SURFACES,
    deviation_map,
    figure,
    image,
    polar_frame,
    robust,
    round_down,
    single,
    styled,
)


@styled
def raw_scan(evidence: Evidence) -> Figure:
    """The scan as it came: range over table turns and points."""
    fig, axes = single(4.6, 3.6)
    values = evidence.raw.range.T
    seen = values[np.isfinite(values)]
    limits = (float(np.quantile(seen, 0.005)), float(np.quantile(seen, 0.995))) if seen.size else (0.0, 1.0)
    drawn = image(axes, values, (0.0, evidence.raw.turns, 0.0, 1.0), limits, SEQUENTIAL)
    axes.set(xlabel="table turns", ylabel="along the laser line (first to last point)", yticks=[])
    fig.colorbar(drawn, ax=axes, label="range (mm)", shrink=0.85)
    return fig


@styled
def projection(evidence: Evidence) -> Figure:
    """All profiles on top of each other, coloured by the surface that each reading was taken for."""
    p = evidence.projection
    fig, axes = single(4.6, 3.6)
    other = p.cylinder < 0
    axes.plot(p.x[other], p.z[other], ".", ms=1.0, color=PALE, label="other", rasterized=True)
    for k, name in enumerate(p.names):
        on = p.cylinder == k
        axes.plot(p.x[on], p.z[on], ".", ms=1.0, color=SURFACES[k % len(SURFACES)], label=name, rasterized=True)
    axes.plot(p.line_x, p.line_z, color=INK, lw=1.2, label=f"{p.names[0]} line" if p.names else "line")
    _angle_mark(axes, p)
    axes.set(xlabel="x along the laser line (mm)", ylabel="z range (mm)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.legend(loc="upper left" if p.phi < 0 else "upper right", markerscale=6)
    return fig


def _angle_mark(axes: Axes, p: Projection) -> None:
    """phi, drawn between the sensor's z and the axis at the lower end of the base line."""
    x0, z0 = float(p.line_x[0]), float(p.line_z[0])
    length = 9.0  # mm
    axes.plot([x0, x0], [z0, z0 + length], color=GREY, lw=0.8, ls=(0, (4, 3)))
    t = np.linspace(0.0, p.phi, 40)
    axes.plot(x0 + 0.6 * length * np.sin(t), z0 + 0.6 * length * np.cos(t), color=INK, lw=0.8)
    beyond = 1.0 if p.phi < 0 else -1.0
    axes.annotate(
        f"φ = {degrees(p.phi):.3f}°".replace("-", "\N{MINUS SIGN}"), (x0 + beyond, z0 + 0.5 * length),
        ha="left" if beyond > 0 else "right", va="center", color=INK,
    )  # fmt: skip


@styled
def radial_signal(evidence: Evidence) -> Figure:
    """The base's radial signal over turns, the fit and the Fourier wave."""
    w = evidence.wave
    fig, axes = single(9.2, 2.6)
    axes.plot(w.turns, um(1) * w.signal, color=PALE, lw=3.0, label="measured, mean over the base")
    axes.plot(
        w.turns, um(1) * w.fitted, color=EXACT, lw=1.2, label="first harmonic, least squares at the table's frequency"
    )
    axes.plot(w.turns, um(1) * w.fourier, color=PAPER, lw=1.2, ls=(0, (4, 2)), label="nearest Fourier bin")
    axes.set(xlabel="table turns", ylabel="radial position − R (µm)", xlim=(0, float(w.turns[-1])))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.22), ncols=3)
    return fig


@styled
def spectrum(evidence: Evidence, paper: Calibration | None) -> Figure:
    """The leakage made visible: the true line at 1 per turn falls between the bins that exist."""
    s = evidence.spectrum
    fig, axes = single(9.2, 2.6)
    axes.plot(s.dense_frequency, um(1) * s.dense_amplitude, color=PALE, lw=1.5, label="between the bins")
    inside = s.frequency <= 6.0
    axes.vlines(s.frequency[inside], 0, um(1) * s.amplitude[inside], color=PAPER, lw=1.4)
    axes.plot(
        s.frequency[inside], um(1) * s.amplitude[inside], "o", ms=4, color=PAPER, label="Fourier bins of this scan"
    )
    axes.plot([1.0], [um(s.fit_amplitude)], "D", ms=6, color=EXACT, label="least squares at 1 per turn")
    axes.axvline(1.0, color=EXACT, lw=0.8, ls=(0, (2, 2)))
    note = f"bin {s.bin}: {um(s.amplitude[s.bin]):.1f} µm at {s.frequency[s.bin]:.3f} per turn"
    if paper is not None and paper.paper is not None:
        note += f"\nphase off by {paper.paper.phase_error_pi:.3f} π".replace("-", "\N{MINUS SIGN}")
    axes.annotate(
        note, (s.frequency[s.bin], um(s.amplitude[s.bin])), xytext=(22, -6), textcoords="offset points", va="top",
        arrowprops={"arrowstyle": "-", "color": GREY, "lw": 0.8},
    )  # fmt: skip
    axes.set(xlabel="frequency (per turn)", ylabel="amplitude (µm)", xlim=(0, 6.0), ylim=(0, None))
    axes.legend(loc="upper right")
    return fig


@styled
def flat_maps(m: FlatMap) -> Figure:
    """Deviation from the nominal radius before, by the published compensation and by the exact model."""
    panels = [("before: only the angle φ applied", m.before), ("exact model: the axis moved", m.stand)]
    if m.paper is not None:
        panels.insert(1, ("published compensation: sinusoid subtracted", m.paper))
    fig = figure(9.2, 1.55 * len(panels) + 0.3)
    rows = fig.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    wide, narrow = um(robust(m.before)), um(robust(m.paper, m.stand))
    for axes, (title, values) in zip(rows, panels, strict=True):
        limit = wide if values is m.before else narrow
        axes.set(title=title, ylabel="height (mm)")
        deviation_map(fig, axes, um(1) * values, (0.0, m.turns, m.low, m.high), limit)
    rows[-1].set_xlabel("table turns")
    return fig


@styled
def rolled_up(r: Rolled) -> Figure:
    """One section rolled up, deviations magnified, around the nominal circle."""
    panels = [("before", r.before, BEFORE), ("exact model", r.stand, EXACT)]
    if r.paper is not None:
        panels.insert(1, ("published compensation", r.paper, PAPER))
    fig = figure(9.2, 3.5)
    for i, (title, (angle, deviation), colour) in enumerate(panels):
        axes = fig.add_subplot(1, len(panels), i + 1, aspect="equal")
        largest = float(np.quantile(np.abs(deviation), 0.995)) if deviation.size else 1.0
        factor = round_down(max(0.3 * r.radius / max(largest, 1e-6), 1.0))
        circle = np.linspace(0, tau, 361)
        axes.plot(r.radius * np.cos(circle), r.radius * np.sin(circle), color=GREY, lw=0.8, ls=(0, (4, 3)))
        radius = r.radius + factor * deviation
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), ".", ms=1.6, color=colour, rasterized=True)
        spread = um(float(np.ptp(deviation))) if deviation.size else 0.0
        axes.text(
            0, 0, f"× {factor:,.0f}\nspan {spread:.1f} µm".replace(",", "\N{THIN SPACE}"), ha="center", va="center"
        )
        polar_frame(axes, title, 1.38 * r.radius)
    return fig


@styled
def residual_map(m: FlatMap) -> Figure:
    """What is left after everything fitted."""
    fig, axes = single(9.2, 1.9)
    axes.set(xlabel="table turns", ylabel="height (mm)")
    deviation_map(fig, axes, um(1) * m.residual, (0.0, m.turns, m.low, m.high), um(robust(m.residual)))
    return fig


@styled
def static_shapes(profiles: tuple[StaticProfile, ...]) -> Figure:
    """What does not turn with the table, per surface, over height."""
    fig, axes = single(9.2, 2.4)
    axes.axhline(0.0, color=PALE, lw=0.8)
    for k, p in enumerate(profiles):
        axes.plot(p.height, um(1) * p.deviation, color=SURFACES[k % len(SURFACES)], lw=1.6, label=p.surface)
    span = max((um(float(np.abs(p.deviation).max())) for p in profiles), default=1.0)
    axes.set(
        xlabel="height above the shoulder (mm)", ylabel="deviation (µm)", ylim=(-1.2 * max(span, 1), 1.2 * max(span, 1))
    )
    axes.legend(loc="upper left", ncols=len(profiles) or 1)
    return fig


@styled
def form_bars(calibration: Calibration) -> Figure:
    """Amplitude of the form harmonics of every surface."""
    names = list(dict.fromkeys(h.surface for h in calibration.harmonics))
    fig, axes = single(9.2, 2.2)
    width = 0.8 / max(len(names), 1)
    for k, name in enumerate(names):
        harmonics = [h for h in calibration.harmonics if h.surface == name and h.upr <= 20]
        at = [h.upr + (k - (len(names) - 1) / 2) * width for h in harmonics]
        axes.bar(at, [um(h.amplitude) for h in harmonics], width, color=SURFACES[k % len(SURFACES)], label=name)
    axes.set(xlabel="undulations per revolution (UPR)", ylabel="amplitude (µm)", yscale="symlog")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper right")
    return fig
