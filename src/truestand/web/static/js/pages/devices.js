// Who answers on the stand.

import { get } from "../api.js";
import { add, h, put } from "../dom.js";
import { icon } from "../marks.js";
import { alertBox, busy, button, empty, heading, link, verdict } from "../parts.js";
import { store } from "../store.js";
import { t } from "../texts.js";

export async function show(page, _, signal) {
  const list = h("div", { "aria-live": "polite" });
  add(page, heading(t("devices.title"), button(t("devices.again"), look, { sign: "again" })), list);
  look();

  async function look() {
    put(list, busy(t("devices.asking")));
    try {
      const devices = await get("api/devices", signal);
      put(list, devices.length ? h("ul", { class: "device-list" }, devices.map(device)) : empty(t("devices.none"), store.engineer && link(t("page.recipes"), "/recipes/stand.toml", { kind: "primary" })));
    } catch (wrong) {
      if (wrong.name === "AbortError") return;
      put(list, alertBox(wrong.message, wrong.status === 409 ? "open" : "bad"), wrong.status === 409 && link(t("job.show"), "/job", { kind: "primary" }));
    }
  }
}

function device(d) {
  const facts = Object.entries(d.told ?? {});
  return h("li", { class: `card device ${d.answers ? "good" : "bad"}` },
    h("div", { class: "top" }, icon(d.device === "table" ? "table" : "sensor"), h("div", {}, h("h2", {}, d.name), h("p", { class: "facts" }, [d.device !== d.name && d.device, d.address].filter(Boolean).join(" · "))), verdict(d.answers ? "answers" : "silent")),
    d.problem && h("p", { class: "problem" }, d.problem),
    facts.length > 0 && h("dl", { class: "facts-list" }, facts.map(([name, value]) => [h("dt", {}, name), h("dd", {}, String(value))])));
}
