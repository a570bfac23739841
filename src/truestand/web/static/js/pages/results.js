// All results, newest first.

import { get } from "../api.js";
import { add, h, put } from "../dom.js";
import { mark } from "../marks.js";
import { alertBox, button, empty, heading, rows, segments, select } from "../parts.js";
import { store } from "../store.js";
import { t } from "../texts.js";

const MANY = 30;
const MOST = 500;
const KINDS = ["", "inspection", "calibration", "verification"];
const wanted = { kind: "", part: "" };

export async function show(page, _, signal) {
  const parts = await get("api/parts", signal);
  const list = h("div", { class: "list" });
  const more = h("div", { class: "actions" });
  const audit = h("div", { role: "status" });
  const filters = h("div", { class: "filters" });
  let entries = [];
  add(page, heading(t("results.title"), store.engineer && button(t("audit.run"), check, { kind: "quiet" })), audit, filters, list, more);
  filter();
  store.onChange(() => renew().catch(() => {}), signal); // the frame says that the stand does not answer
  await renew();

  function filter() {
    put(filters, segments(t("results.kind"), KINDS.map((value) => ({ value, label: t(value ? `kinds.${value}` : "results.every") })), wanted.kind, (kind) => change({ kind })),
      select(t("results.part"), [{ value: "", label: t("results.every_part") }, ...parts.map((p) => ({ value: p.name, label: p.title || p.name }))], wanted.part, (part) => change({ part })));
  }

  async function change(choice) {
    Object.assign(wanted, choice);
    entries = [];
    await renew();
  }

  async function addOlder() {
    const shown = entries;
    const before = shown.at(-1)?.number;
    const found = await ask(MANY, before && { before });
    if (entries === shown) draw(shown.concat(found), found.length === MANY);
    else await addOlder(); // something newer was drawn meanwhile
  }

  /** The same ones as they are now, and those that came. */
  async function renew() {
    const shown = entries;
    const limit = Math.min(Math.max(MANY, shown.length), MOST);
    const found = await ask(limit);
    if (entries === shown) draw(found, found.length === limit);
    else await renew();
  }

  function ask(limit, from = {}) {
    const asked = new URLSearchParams({ limit, ...(wanted.kind && { kind: wanted.kind }), ...(wanted.part && { part: wanted.part }), ...from });
    return get(`api/results?${asked}`, signal);
  }

  function draw(found, older) {
    entries = found;
    put(list, entries.length ? rows(entries) : empty(t(wanted.kind || wanted.part ? "results.none_such" : "results.none")));
    put(more, older ? button(t("results.more"), addOlder) : "");
  }

  async function check(event) {
    const pressed = event.currentTarget;
    pressed.disabled = true;
    put(audit, h("p", { class: "note" }, t("audit.running")));
    try {
      const { findings } = await get("api/audit", signal);
      put(audit, findings.length
        ? h("section", { class: "notice bad" }, mark("bad"), h("div", {}, h("h2", {}, t("audit.found", { n: findings.length })), h("ul", {}, findings.map((f) => h("li", {}, h("strong", {}, f.where), ": ", f.what)))))
        : h("section", { class: "notice good" }, mark("good"), h("p", {}, t("audit.clean"))));
    } catch (wrong) {
      put(audit, alertBox(wrong.message));
    }
    pressed.disabled = false;
  }
}
