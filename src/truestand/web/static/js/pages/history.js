// How quantities and characteristics move over time: control limits, U, and what stands out.

import { get } from "../api.js";
import { chart, level, plain } from "../charts.js";
import { add, colour, h, put, s } from "../dom.js";
import { number, places, short, when, withU } from "../format.js";
import { mark } from "../marks.js";
import { empty, heading, select } from "../parts.js";
import { t } from "../texts.js";

export async function show(page, { of = "calibration", quantity }, signal) {
  const parts = await get("api/parts", signal);
  const asked = of === "calibration" ? "kind=calibration" : `kind=inspection&part=${encodeURIComponent(of)}`;
  const { quantities } = await get(`api/history?${asked}`, signal);
  const some = quantities.filter((q) => q.points.length);
  const options = [{ value: "calibration", label: t("history.calibration") }, ...parts.map((p) => ({ value: p.name, label: p.title || p.name }))];
  add(page, heading(t("history.title")), h("div", { class: "filters" }, select(t("history.of"), options, of, (value) => (location.hash = `/history/${encodeURIComponent(value)}`))));
  if (!some.length) {
    add(page, empty(t("history.none")));
    return;
  }
  const chosen = some.find((q) => q.name === quantity) ?? some.find((q) => q.findings?.length) ?? some[0];
  add(page, h("div", { class: "trends" }, choices(of, some, chosen), h("section", { class: "card trend", "aria-labelledby": "trend-title" }, trend(chosen))));
}

export function shown(page, signal) {
  const place = page.querySelector(".trend .here");
  if (place) draw(place, place.quantity, signal);
  page.querySelector(".quantity[aria-current]")?.scrollIntoView({ block: "nearest" });
}

function choices(of, quantities, chosen) {
  return h("ul", { class: "quantities-list", "aria-label": t("history.quantities") }, quantities.map((q) => h("li", {},
    h("a", { class: "quantity", href: `#/history/${encodeURIComponent(of)}/${encodeURIComponent(q.name)}`, "aria-current": q === chosen ? "true" : null },
      q.findings?.length ? mark("bad") : mark("good"), h("span", { class: "name" }, q.label, q.findings?.length > 0 && h("span", { class: "unseen" }, ` (${t("history.finding")})`)), h("span", { class: "value" }, withU(q.points.at(-1).value, q.points.at(-1).U, q.unit)), spark(q)))));
}

/** The last points as a line too small to read, to compare. */
function spark({ points, lower, upper }) {
  const last = points.slice(-20);
  const values = last.map((p) => p.value).concat([lower, upper].filter(Number.isFinite));
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const y = (v) => 26 - (22 * (v - low)) / (high - low || 1);
  const x = (i) => 3 + (94 * i) / Math.max(1, last.length - 1);
  return s("svg", { class: "spark", viewBox: "0 0 100 30", "aria-hidden": "true" },
    Number.isFinite(lower) && Number.isFinite(upper) && s("rect", { x: 0, width: 100, y: y(upper), height: Math.max(0, y(lower) - y(upper)) }),
    s("polyline", { points: last.map((p, i) => `${x(i).toFixed(1)},${y(p.value).toFixed(1)}`).join(" ") }), s("circle", { cx: x(last.length - 1), cy: y(last.at(-1).value), r: 3 }));
}

function trend(q) {
  const rounded = (value) => number(value, places(q.points.at(-1).U));
  const place = h("div", { class: "here", prop: { quantity: q } });
  return [h("h2", { id: "trend-title" }, q.label),
    h("dl", { class: "tiles" }, tile(t("history.last"), withU(q.points.at(-1).value, q.points.at(-1).U, q.unit)), tile(t("history.centre"), rounded(q.centre), q.unit),
      tile(t("history.control"), Number.isFinite(q.lower) ? `${rounded(q.lower)} … ${rounded(q.upper)}` : "–", q.unit), limit(q) && tile(t("table.limit"), limit(q).map(short).join(" … "), q.unit)),
    findings(q), place, h("p", { class: "note" }, t("history.legend"))];
}

function tile(name, value, unit = "") {
  return h("div", {}, h("dt", {}, name), h("dd", {}, value, unit && value !== "–" && h("span", { class: "unit" }, ` ${unit}`)));
}

/** The limits of a characteristic, as one number or a pair. */
function limit(q) {
  const found = [q.limits ?? q.limit ?? null].flat().filter(Number.isFinite);
  return found.length ? found : null;
}

function findings(q) {
  if (!q.findings?.length) return h("div", { class: "notice good" }, mark("good"), h("p", {}, t("history.steady")));
  return h("div", { class: "notice bad" }, mark("bad"), h("ul", {}, q.findings.map((f) => h("li", {}, h("a", { class: "plain", href: `#/results/${f.number}` }, `#${f.number}`), ": ", f.text))));
}

function draw(place, q, signal) {
  put(place);
  const found = new Set((q.findings ?? []).map((f) => f.number));
  return chart(place, `${q.label}, ${q.unit}`, () => [{
    type: "scatter", mode: "lines+markers", x: q.points.map((p) => p.time), y: q.points.map((p) => p.value),
    error_y: { type: "data", array: q.points.map((p) => p.U ?? 0), color: colour("series-1"), thickness: 1.6, width: 4 },
    line: { color: colour("series-1"), width: 2 },
    marker: { size: q.points.map((p) => (found.has(p.number) ? 16 : 9)), symbol: q.points.map((p) => (found.has(p.number) ? "x" : "circle")), color: q.points.map((p) => colour(found.has(p.number) ? "bad" : "series-1")) },
    text: q.points.map((p) => plain(`#${p.number} · ${when(p.time)}`)), hovertemplate: `%{text}<br>%{y} ${plain(q.unit)}<extra></extra>`,
  }], () => ({
    height: 420, showlegend: false, xaxis: { type: "date" }, yaxis: { title: { text: plain(q.unit) } },
    shapes: [Number.isFinite(q.centre) && level(q.centre, "solid", "soft"), Number.isFinite(q.lower) && level(q.lower, "dash", "open"), Number.isFinite(q.upper) && level(q.upper, "dash", "open"), ...(limit(q) ?? []).map((v) => level(v, "solid", "bad"))].filter(Boolean),
  }), signal);
}
