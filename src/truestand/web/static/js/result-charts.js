// The charts of one result.

import { chart, plain, series } from "./charts.js";
import { colour, h, put } from "./dom.js";
import { empty, select } from "./parts.js";
import { known, t } from "./texts.js";
import { chartSymbol, mainLines, plainSymbol, usage, where, whole } from "./lines.js";

export async function resultCharts(panel, entry, record, signal) {
  put(panel);
  const drawn = { inspection, calibration, verification }[entry.kind];
  await drawn?.(panel, record, signal);
  if (!panel.firstChild && !signal.aborted) put(panel, empty(t("charts.none")));
}

async function inspection(panel, record, signal) {
  const lines = whole(record).filter((c) => usage(c) !== null).reverse();
  if (lines.length) await limits(panel, lines, signal);
  const all = mainLines(record);
  const teeth = all.filter((c) => Number.isFinite(c.tooth));
  if (teeth.length) await chosen(panel, t("charts.teeth"), names(teeth), (name, place, mine) => byTooth(place, teeth.filter((c) => c.name === name), mine), signal);
  const budgets = whole(record).filter((c) => c.contributions?.length);
  const keys = budgets.map((c) => ({ value: `${c.name} ${c.flank ?? ""} ${c.section ?? ""}`, label: [plainSymbol(c.name), where(c)].filter(Boolean).join(", "), c }));
  if (keys.length) await chosen(panel, t("charts.budget"), keys, (key, place, mine) => { const { c } = keys.find((k) => k.value === key); return budget(place, c.contributions.map((b) => [b.name, c.size ? b.U_mm : b.U_um]), c.unit, mine); }, signal);
}

function names(lines) {
  return [...new Set(lines.map((c) => c.name))].map((value) => ({ value, label: plainSymbol(value) }));
}

/** A chart with a choice above it. */
async function chosen(panel, title, options, draw, signal) {
  const place = h("div", {});
  let mine = null;
  const again = async (value) => {
    mine?.abort();
    mine = new AbortController();
    signal.addEventListener("abort", () => mine.abort(), { once: true });
    put(place);
    await draw(value, place, mine.signal);
  };
  panel.append(h("section", { class: "chosen" }, select(title, options, options[0].value, again), place));
  await again(options[0].value);
}

function limits(panel, lines, signal) {
  const tones = { conforms: "good", does_not_conform: "bad", undecided: "open" };
  const label = (c) => `${chartSymbol(c.name)} ${plain(where(c))} `;
  const end = 105 * Math.max(1.1, ...lines.map((c) => usage(c).value + usage(c).U));
  return chart(panel, t("charts.limits"), () => [{
    type: "bar", orientation: "h", y: lines.map(label), x: lines.map((c) => 100 * usage(c).value),
    error_x: { type: "data", array: lines.map((c) => 100 * usage(c).U), color: colour("ink"), thickness: 2, width: 5 },
    marker: { color: lines.map((c) => colour(tones[c.verdict] ?? "none")), pattern: { shape: lines.map((c) => ({ bad: "x", open: "/" })[tones[c.verdict]] ?? ""), fgcolor: colour("paper"), size: 7 } },
    hovertemplate: "%{y}: %{x:.0f} %<extra></extra>",
  }], () => ({
    height: 90 + 30 * lines.length, xaxis: { title: { text: t("charts.limits.axis") }, range: [0, Math.min(end, 300)], ticksuffix: " %" }, bargap: 0.35,
    shapes: [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: 100, x1: 100, line: { color: colour("ink"), width: 3 } }],
  }), signal);
}

function byTooth(place, lines, signal) {
  const flanks = [...new Set(lines.map((c) => c.flank))];
  const limit = lines.find((c) => c.limited);
  return chart(place, `${plainSymbol(lines[0].name)}, ${lines[0].unit}`, () => flanks.map((flank, i) => {
    const some = lines.filter((c) => c.flank === flank);
    const { color, symbol } = series(i);
    const tooth = some.map((c) => c.tooth + (flanks.length > 1 ? 0.3 * i - 0.15 : 0));
    return { type: "scatter", mode: "markers", name: flank ? t(`flank.${flank}`) : t("word.all"), x: tooth, y: some.map((c) => c.value), text: some.map((c) => String(c.tooth)),
      error_y: { type: "data", array: some.map((c) => c.U), color, thickness: 1.6, width: 3 }, marker: { color, symbol, size: 10 }, hovertemplate: `${plain(t("charts.tooth"))} %{text}: %{y:.2f}<extra></extra>` };
  }), () => ({
    xaxis: { title: { text: t("charts.tooth") }, dtick: lines.length > 60 ? 5 : 1, zeroline: false }, yaxis: { title: { text: lines[0].unit } },
    shapes: limit ? [limit.low, limit.high].filter((v) => v !== null).map((y) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: { color: colour("bad"), width: 2, dash: "dash" } })) : [],
  }), signal);
}

/** Where U comes from, largest at the top. */
function budget(place, contributions, unit, signal) {
  const lines = contributions.filter(([, U]) => Number.isFinite(U)).sort((a, b) => a[1] - b[1]).slice(-12);
  return chart(place, t("charts.budget.of", { unit }), () => [{ type: "bar", orientation: "h", y: lines.map(([name]) => plain(shortened(name))), x: lines.map(([, U]) => U), marker: { color: colour("series-1") }, customdata: lines.map(([name]) => plain(name)), hovertemplate: `%{customdata}: %{x:.3g} ${plain(unit)}<extra></extra>` }],
    () => ({ height: 100 + 34 * lines.length, xaxis: { title: { text: `U, ${unit}` }, rangemode: "tozero" }, bargap: 0.4 }), signal);
}

function shortened(name) {
  return name.length > 46 ? `${name.slice(0, 45)}…` : name;
}

async function calibration(panel, record, signal) {
  const keys = Object.keys(record.uncertainty ?? {}).map((value) => ({ value, label: known(`quantity.${value}`) ? t(`quantity.${value}`) : value }));
  const unit = (key) => ({ um: "µm", mm: "mm", deg: "°", mrad: "mrad" })[key.split("_").at(-1)] ?? "";
  if (keys.length) await chosen(panel, t("charts.budget"), keys, (key, place, mine) => budget(place, record.uncertainty[key].contributions.map((b) => [b.name, b.U]), unit(key), mine), signal);
  if (record.harmonics?.length) await harmonics(panel, record.harmonics, signal);
  if (record.static_profiles?.length) await profiles(panel, record.static_profiles, signal);
}

function harmonics(panel, all, signal) {
  const surfaces = [...new Set(all.map((one) => one.surface))];
  return chart(panel, t("charts.harmonics"), () => surfaces.map((surface, i) => {
    const some = all.filter((one) => one.surface === surface);
    return { type: "bar", name: plain(surface), x: some.map((one) => one.upr), y: some.map((one) => one.amplitude_um), marker: { color: series(i).color, pattern: { shape: ["", "/", "x", "."][i % 4], fgcolor: colour("paper"), size: 6 } }, hovertemplate: "%{x} UPR: %{y:.3g} µm<extra></extra>" };
  }), () => ({ xaxis: { title: { text: "UPR" }, dtick: 1 }, yaxis: { title: { text: "µm" } } }), signal);
}

function profiles(panel, all, signal) {
  return chart(panel, t("charts.static"), () => all.map((one, i) => ({ type: "scatter", mode: "lines+markers", name: plain(one.surface), x: one.height_mm, y: one.deviation_um, line: { color: series(i).color, width: 2 }, marker: { ...series(i), size: 6 }, hovertemplate: "%{x:.1f} mm: %{y:.2f} µm<extra></extra>" })),
    () => ({ xaxis: { title: { text: t("charts.height") } }, yaxis: { title: { text: "µm" } } }), signal);
}

function verification(panel, record, signal) {
  const lines = [...(record.changes ?? [])].reverse();
  if (!lines.length) return undefined;
  return chart(panel, t("charts.changes"), () => [{ type: "bar", orientation: "h", y: lines.map((c) => plain(c.name)), x: lines.map((c) => c.value_um), error_x: { type: "data", array: lines.map((c) => c.U_um), color: colour("ink"), thickness: 2, width: 5 }, marker: { color: colour("series-1") }, hovertemplate: "%{y}: %{x:.2f} µm<extra></extra>" }],
    () => ({ height: 120 + 50 * lines.length, bargap: 0.5, xaxis: { title: { text: "µm" } }, shapes: [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: lines[0].limit_um, x1: lines[0].limit_um, line: { color: colour("bad"), width: 3, dash: "dash" } }] }), signal);
}
