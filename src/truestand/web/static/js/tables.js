// The tables of a result: characteristics, quantities, checks, changes, defects, and what it rests on.

import { h, s } from "./dom.js";
import { number, places, short, when, withU } from "./format.js";
import { verdict } from "./parts.js";
import { known, t } from "./texts.js";
import { limitText, meaning, sentence, symbol, usage, where, whole } from "./lines.js";

/** The panel of a tab. */
export function details(tab, entry, record) {
  if (tab === "evidence") return evidence(record);
  return { inspection, calibration, verification }[entry.kind]?.(record) ?? "";
}

function table(caption, head, body, kind = "") {
  return h("div", { class: "wide", tabindex: "0", role: "region", "aria-label": caption }, h("table", { class: kind }, h("caption", {}, caption),
    h("thead", {}, h("tr", {}, head.map(([name, at]) => h("th", { scope: "col", class: at ?? "" }, name)))), h("tbody", {}, body)));
}

function inspection(record) {
  const lines = whole(record).sort((a, b) => rank(a) - rank(b));
  const head = [[t("table.characteristic")], [t("table.value"), "n"], [t("table.limit"), "n"], [t("table.used"), "used"], [t("table.verdict")]];
  return [table(t("table.characteristics"), head, lines.map(characteristic)), defects(record)];
}

/** What was not measurable first, then failing, undecided, the rest as they come. */
function rank(c) {
  if (c.status === "not_measurable") return 0;
  return { does_not_conform: 1, undecided: 2, conforms: 3 }[c.verdict] ?? 4;
}

function characteristic(c) {
  const unseen = c.status === "not_measurable";
  return h("tr", { class: unseen ? "gone" : (c.verdict ?? "") },
    h("th", { scope: "row" }, symbol(c.name), h("span", { class: "where" }, where(c)), h("small", {}, meaning(c.name))),
    h("td", { class: "n" }, unseen ? h("span", { class: "none" }, t("word.not_measurable")) : [h("strong", {}, c.bound, number(c.value, places(c.U, c.most))), h("span", { class: "U" }, Number.isFinite(c.U) ? ` ± ${number(c.U, places(c.U, c.most))}` : ""), h("span", { class: "unit" }, ` ${c.unit}`)],
      c.status === "partial" && h("small", {}, t("word.partial", { share: Math.round(100 * c.coverage) }))),
    h("td", { class: "n" }, c.limited ? [limitText(c), h("span", { class: "unit" }, ` ${c.unit}`)] : h("span", { class: "none" }, "–")),
    h("td", { class: "used" }, bar(usage(c), c.verdict)),
    h("td", {}, c.verdict ? [verdict(c.verdict), c.capable === false && !c.at_least && h("small", {}, t("word.not_capable")), c.verdict === "undecided" && c.reason && h("small", {}, sentence(c.reason))] : h("span", { class: "none" }, c.limited && c.standard?.includes("informative") ? t("word.informative") : "")));
}

/** How much of the limit is used, with U as a whisker; the upright line is the limit. */
function bar(used, word) {
  if (!used) return null;
  const x = (share) => 2 + 100 * Math.min(Math.max(share, 0), 1.5);
  const tone = { conforms: "good", does_not_conform: "bad", undecided: "open" }[word] ?? "none";
  return s("svg", { class: `usage ${tone}`, viewBox: "0 0 156 24", role: "img", "aria-label": t("table.used.of", { share: Math.round(100 * used.value), U: Math.round(100 * used.U) }) },
    s("rect", { x: 2, y: 7, width: 100, height: 10, rx: 2, class: "track" }), s("rect", { x: 2, y: 7, width: x(used.value) - 2, height: 10, rx: 2, class: "fill" }),
    s("path", { d: `M${x(used.value - used.U)} 12H${x(used.value + used.U)}M${x(used.value - used.U)} 8v8M${x(used.value + used.U)} 8v8`, class: "whisker" }),
    s("path", { d: "M102 1v22", class: "limit" }));
}

function defects(record) {
  if (!record.defects?.length) return record.part?.kind === "gear" ? h("p", { class: "note big" }, t("defects.none")) : "";
  const head = [[t("defects.kind")], [t("defects.tooth"), "n"], [t("defects.flank")], [t("defects.height"), "n"], [t("defects.depth"), "n"]];
  return table(t("defects.title"), head, record.defects.map((d) => h("tr", { class: d.verdict ?? (record.defect_limit_um !== null && d.depth_um > record.defect_limit_um ? "does_not_conform" : "") },
    h("th", { scope: "row" }, known(`defect.${d.kind}`) ? t(`defect.${d.kind}`) : d.kind), h("td", { class: "n" }, d.tooth ?? "–"), h("td", {}, d.flank ? t(`flank.${d.flank}`) : "–"),
    h("td", { class: "n" }, `${number(d.height_mm, 1)} mm`), h("td", { class: "n" }, `${number(d.depth_um, 0)} µm`))));
}

/** Quantities of a calibration: key, where it stands, unit. */
const QUANTITIES = [
  ["eccentricity_um", (r) => r.shaft?.eccentricity_um, "µm"],
  ["eccentricity_direction_deg", (r) => r.shaft?.eccentricity_direction_deg, "°"],
  ["tilt_mrad", (r) => r.shaft?.tilt_mrad, "mrad"],
  ["tilt_direction_deg", (r) => r.shaft?.tilt_direction_deg, "°"],
  ["phi_deg", (r) => r.sensor?.phi_deg, "°"],
  ["radial_position_mm", (r) => r.sensor?.table_from_sensor?.[0]?.[3], "mm"],
  ["laser_plane_offset_mm", (r) => r.sensor?.laser_plane_offset_mm, "mm"],
  ["laser_plane_tilt_deg", (r) => r.sensor?.laser_plane_tilt_deg, "°"],
];

function calibration(record) {
  const gone = record.not_identifiable ?? [];
  const tiles = QUANTITIES.map(([key, read, unit]) => [key, read(record), record.uncertainty?.[key]?.U, unit]).filter(([key, value]) => Number.isFinite(value) || gone.includes(key));
  return [
    gone.length > 0 && h("div", { class: "notice open" }, h("p", {}, h("strong", {}, t("calibration.gone")), ": ", gone.map((name) => (known(`quantity.${name}`) ? t(`quantity.${name}`) : name)).join(", "))),
    h("dl", { class: "tiles quantities" }, tiles.map(([key, value, U, unit]) => h("div", {}, h("dt", {}, t(`quantity.${key}`)), h("dd", {}, withU(value, U, unit))))),
    h("p", { class: "note" }, t("word.k2")), checks(record)];
}

function checks(record) {
  const head = [[t("checks.check")], [t("checks.value"), "n"], [t("checks.limit"), "n"], [t("checks.result")]];
  return table(t("checks.title"), head, (record.checks ?? []).map((c) => h("tr", { class: c.ok ? "" : "does_not_conform" },
    h("th", { scope: "row" }, sentence(c.name), !c.ok && h("small", {}, sentence(c.advice))), h("td", { class: "n" }, short(Number(c.value.toPrecision(4)))), h("td", { class: "n" }, short(c.limit)), h("td", {}, verdict(c.ok ? "kept" : "broken")))));
}

function verification(record) {
  const head = [[t("changes.what")], [t("changes.value"), "n"], [t("table.limit"), "n"], [t("table.used"), "used"], [t("table.verdict")]];
  const words = { holds: "conforms", does_not_hold: "does_not_conform", undecided: "undecided" };
  return [table(t("changes.title"), head, (record.changes ?? []).map((c) => h("tr", { class: words[c.verdict] },
    h("th", { scope: "row" }, c.name, c.verdict === "does_not_hold" && h("small", {}, sentence(c.advice))), h("td", { class: "n" }, withU(c.value_um, c.U_um, "µm", 2)), h("td", { class: "n" }, `${short(c.limit_um)} µm`),
    h("td", { class: "used" }, bar({ value: Math.abs(c.value_um) / c.limit_um, U: c.U_um / c.limit_um }, words[c.verdict])), h("td", {}, verdict(c.verdict))))), h("p", { class: "note" }, t("word.k2"))];
}

/** How it was evaluated and what it rests on. */
function evidence(record) {
  const { scan, calibration: used, settings } = record;
  const rows = [
    [t("evidence.software"), record.software], [t("evidence.created"), when(record.created)],
    scan && [t("evidence.scan"), t("evidence.scan.text", { profiles: number(scan.profiles, 0), points: number(scan.points, 0), turns: number(scan.revolutions, 2), seen: number(100 * scan.seen, 1) })],
    scan && [t("evidence.scan.hash"), h("code", {}, scan.sha256)], record.artefact?.name && [t("evidence.artefact"), record.artefact.name],
    used?.sha256 && [t("evidence.calibration"), h("code", {}, used.sha256)], record.valid_until && [t("evidence.valid"), when(record.valid_until)],
    ...Object.entries(settings ?? {}),
  ].filter(Boolean);
  return [record.remarks?.length > 0 && h("section", {}, h("h2", {}, t("evidence.remarks")), h("ul", { class: "remarks" }, record.remarks.map((remark) => h("li", {}, sentence(remark))))),
    h("h2", {}, t("evidence.title")), h("dl", { class: "facts-list" }, rows.map(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]))];
}
