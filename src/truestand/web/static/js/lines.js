// Lines of an inspection record in the units that people read: one place that knows its keys.

import { h } from "./dom.js";
import { short, withU } from "./format.js";
import { judged, mark } from "./marks.js";
import { known, t } from "./texts.js";

const MOST_NAMED = 4;

/** {value, U, low, high, unit, most, …} of a characteristic; sizes in mm, deviations in um. A lower bound has no U. */
export function line(c) {
  const size = "value_mm" in c;
  const unit = size ? "mm" : "µm";
  const [low, high] = (size ? c.limits_mm : c.limits_um) ?? [null, null];
  return { ...c, size, unit, value: size ? c.value_mm : c.value_um, U: c.at_least ? null : size ? c.U_mm : c.U_um, bound: c.at_least ? "≥ " : "", low, high, limited: low !== null || high !== null, most: size ? 4 : 2 };
}

/** The sentence of a reason or remark, micrometres with their sign; records of version 1 have it without a code. */
export function sentence(message) {
  return (typeof message === "string" ? message : message.text).replace(/\bum\b/g, "µm");
}

export function limitText({ low, high }) {
  if (low === null && high === null) return "–";
  if (low === null) return `≤ ${short(high)}`;
  if (high === null) return `≥ ${short(low)}`;
  return Math.abs(low + high) < 1e-9 ? `± ${short(high)}` : `${short(low)} … ${short(high)}`;
}

/** The share of the limit that the value uses, and that of its U; null without a limit. */
export function usage({ value, U, low, high }) {
  if (!Number.isFinite(value)) return null;
  const [middle, half] = zone(low, high);
  if (!(half > 0)) return null;
  return { value: low !== null && high !== null ? Math.abs(value - middle) / half : Math.max(0, value / (high ?? low)), U: (U ?? 0) / half };
}

/** Where nothing of the limit is used, and how far from there to the limit. A one-sided limit starts at zero. */
function zone(low, high) {
  if (low !== null && high !== null) return [(low + high) / 2, (high - low) / 2];
  if (high !== null) return [0, high];
  return [0, low !== null && low < 0 ? -low : null];
}

/** f_Halpha as f with its index below; other names in words. */
export function symbol(name) {
  if (known(`name.${name}`)) return h("span", { class: "symbol" }, t(`name.${name}`));
  const [stem, ...rest] = name.split("_");
  const below = greek(rest.join(" "));
  return h("span", { class: "symbol" }, h("i", {}, stem), below && h("sub", {}, below));
}

/** The same as plain text, for lists of choices. */
export function plainSymbol(name) {
  return known(`name.${name}`) ? t(`name.${name}`) : greek(name);
}

/** The same for plotly, which reads these two tags; anything else in the name is kept from it. */
export function chartSymbol(name) {
  if (known(`name.${name}`)) return t(`name.${name}`);
  const [stem, ...rest] = name.replace(/[<>&]/g, "").split("_");
  return rest.length ? `<i>${stem}</i><sub>${greek(rest.join(" "))}</sub>` : stem;
}

export function meaning(name) {
  return known(`meaning.${name}`) ? t(`meaning.${name}`) : "";
}

/** Flank, tooth or section, in words. */
export function where(c) {
  return [c.flank && t(`flank.${c.flank}`), c.tooth && t("word.tooth", { number: c.tooth }), c.section].filter(Boolean).join(", ");
}

/** All lines but those that leave damage out, which are information. */
export function mainLines(record) {
  return (record.characteristics ?? []).filter((c) => !c.without_damage).map(line);
}

export function whole(record) {
  return mainLines(record).filter((c) => c.tooth === null || c.tooth === undefined);
}

/** Doubts about the calibration first; then the lines that carry a verdict, named; what can't be measured first. */
export function decisive(entry, record) {
  const items = entry.doubts.map((doubt) => h("li", { class: "open" }, mark("open"), h("span", {}, doubt)));
  const lines = whole(record);
  const unseen = lines.filter((c) => c.status === "not_measurable");
  if (unseen.length) items.push(h("li", { class: "open" }, mark("open"), h("span", {}, h("strong", {}, t("result.unseen")), ": ", list(unseen.map((c) => c.name)))));
  for (const reason of record.reasons ?? []) items.push(h("li", { class: "open" }, mark("open"), h("span", {}, sentence(reason))));
  for (const verdict of ["does_not_conform", "undecided"]) {
    const broken = (record.defects ?? []).filter((d) => d.verdict === verdict);
    for (const d of broken.slice(0, MOST_NAMED))
      items.push(h("li", { class: judged(verdict).tone }, mark(judged(verdict).tone), t("result.broken", { tooth: d.tooth, kind: t(`defect.${d.kind}`) })));
    if (broken.length > MOST_NAMED) items.push(h("li", { class: judged(verdict).tone }, mark(judged(verdict).tone), t("result.more", { n: broken.length - MOST_NAMED })));
    const found = lines.filter((c) => c.verdict === verdict && c.status !== "not_measurable");
    const { tone, word } = judged(verdict);
    for (const c of found.slice(0, MOST_NAMED))
      items.push(h("li", { class: tone }, mark(tone), h("span", {}, symbol(c.name), " ", where(c), ": ", h("strong", {}, c.bound, withU(c.value, c.U, c.unit, c.most)), ` (${t("word.limit")} ${limitText(c)}) `, h("span", { class: "unseen" }, word))));
    if (found.length > MOST_NAMED) items.push(h("li", { class: tone }, mark(tone), t("result.more", { n: found.length - MOST_NAMED })));
  }
  const deep = (record.defects ?? []).filter((d) => record.defect_limit_um !== null && d.depth_um > record.defect_limit_um);
  if (deep.length) items.push(h("li", { class: "bad" }, mark("bad"), t("result.deep", { n: deep.length, limit: short(record.defect_limit_um) })));
  const bad = (record.checks ?? []).filter((check) => !check.ok);
  for (const check of bad) items.push(h("li", { class: "bad" }, mark("bad"), h("span", {}, h("strong", {}, sentence(check.name)), ": ", sentence(check.advice))));
  return items.length ? h("ul", { class: "decisive" }, items) : "";
}

function list(names) {
  return [...new Set(names)].map((name, i) => [i ? ", " : "", symbol(name)]);
}

function greek(text) {
  return text.replace("alpha", "α").replace("beta", "β");
}

