// One result: the verdict, then what could not be measured, then every line; charts, cloud and evidence behind tabs.

import { get, send } from "../api.js";
import { add, h, put } from "../dom.js";
import { when } from "../format.js";
import { judged, standing } from "../marks.js";
import { alertBox, askWhy, busy, button, heading, link, stamp, titled } from "../parts.js";
import { load, whenBack } from "../modules.js";
import { go, to } from "../router.js";
import { store } from "../store.js";
import { t } from "../texts.js";
import { decisive } from "../lines.js";
import { details } from "../tables.js";

export async function show(page, { number, tab = "values" }, signal) {
  const { entry, record } = await get(`api/results/${number}`, signal);
  const tabs = ["values", "charts", ...(entry.has?.cloud ? ["cloud"] : []), "evidence"];
  const panel = h("div", { class: "panel", role: "tabpanel", id: "panel", tabindex: "0" });
  const bar = h("div", { class: "tabs", role: "tablist", "aria-label": t("result.views"), on: { keydown: step } });
  let inside = null;
  store.onChange(look, signal);
  page.classList.add(entry.standing);
  add(page, heading(titled(entry)), corrected(entry),
    stamp(standing(entry), [t(`kind.${entry.kind}`), entry.serial].filter(Boolean).join(" · "), facts(entry), "p"));
  if (!Object.keys(record).length) return; // it takes another result back
  add(page, decisive(entry, record), h("div", { class: "views" }, bar, h("div", { class: "downloads" }, downloads(entry), withdrawal(entry, page))), panel);
  signal.addEventListener("abort", () => inside?.abort());
  open(tabs.includes(tab) ? tab : "values");

  /** What the result is worth may have changed; its record never does. */
  async function look() {
    const now = await get(`api/results/${number}`, signal).catch(() => null);
    if (now && JSON.stringify(now.entry) !== JSON.stringify(entry)) go();
  }

  function open(name, focus = false) {
    history.replaceState(null, "", `#/results/${number}${name === "values" ? "" : `/${name}`}`);
    put(bar, tabs.map((tab) => h("button", { type: "button", role: "tab", id: `tab-${tab}`, "aria-selected": String(tab === name), "aria-controls": "panel", tabindex: tab === name ? "0" : "-1", on: { click: () => open(tab, true) } }, t(`result.tab.${tab}`))));
    if (focus) bar.querySelector(`#tab-${name}`).focus();
    page.classList.toggle("compact", name !== "values");
    panel.setAttribute("aria-labelledby", `tab-${name}`);
    inside?.abort();
    inside = new AbortController();
    fill(name, inside.signal);
  }

  async function fill(name, mine) {
    put(panel, busy());
    try {
      if (name === "values" || name === "evidence") put(panel, details(name, entry, record));
      if (name === "charts") await (await load("result-charts.js")).resultCharts(panel, entry, record, mine);
      if (name === "cloud") await (await load("cloud.js")).cloud(panel, `api/results/${number}/cloud?points=200000`, mine);
    } catch (wrong) {
      if (mine.aborted || wrong.name === "AbortError") return;
      if (!("status" in wrong)) console.error(wrong);
      put(panel, alertBox(wrong.message));
      whenBack(wrong, () => open(name), mine);
    }
  }

  function step(event) {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const at = tabs.findIndex((tab) => bar.querySelector(`#tab-${tab}`) === document.activeElement);
    const next = by ? tabs[(at + by + tabs.length) % tabs.length] : { Home: tabs[0], End: tabs.at(-1) }[event.key];
    if (!next) return;
    event.preventDefault();
    open(next, true);
  }
}

function facts(entry) {
  const parts = [`#${entry.number}`, when(entry.time), entry.operator, entry.order && t("word.order", { order: entry.order }),
    entry.corrects && t((entry.verdict ?? entry.status) === "withdrawn" ? "result.withdraws" : "result.corrects", { number: entry.corrects }), entry.corrected_by && t("result.was", { verdict: judged(entry.verdict ?? entry.status).word })];
  return parts.filter(Boolean).join(" · ");
}

function corrected(entry) {
  if (!entry.corrected_by) return null;
  return h("div", { class: "notice open" }, h("p", {}, t(`result.${entry.standing}`, { number: entry.corrected_by })), link(t("result.correction"), `/results/${entry.corrected_by}`));
}

/** A button that takes the result back, for engineers; it stays in the store as it was. */
function withdrawal(entry, page) {
  if (!store.engineer || entry.corrected_by) return null;
  return button(t("result.withdraw"), withdraw, { kind: "quiet" });

  async function withdraw() {
    const reason = await askWhy(t("result.withdraw.ask", { number: entry.number }), t(`result.withdraw.${entry.kind}`), t("result.withdraw"), t("result.withdraw.why"));
    if (!reason) return;
    try {
      const made = await send("POST", `api/results/${entry.number}/withdraw`, { reason, operator: localStorage.getItem("operator") });
      to(`/results/${made.number}`);
    } catch (wrong) {
      page.prepend(alertBox(wrong.message));
    }
  }
}

function downloads(entry) {
  const base = `api/results/${entry.number}`;
  return [
    entry.has?.report && link(t("result.report"), `${base}/report`, { sign: "open", target: "_blank", rel: "noopener" }),
    entry.has?.report && link(t("result.report.save"), `${base}/report?download=1`, { sign: "down", download: "" }),
    entry.kind === "inspection" && link("CSV", `${base}/characteristics.csv`, { sign: "down", download: "", "aria-label": t("result.csv") }),
    entry.has?.certificate && link(t("result.certificate"), `${base}/certificate.xml`, { sign: "down", download: "" }),
  ];
}

