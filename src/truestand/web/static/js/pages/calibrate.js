// Calibrate, guided: the artefact, or only a check whether the last calibration still holds.

import { get, loadHome } from "../api.js";
import { add, h } from "../dom.js";
import { button, field, heading, segments, stepper } from "../parts.js";
import { to } from "../router.js";
import { store } from "../store.js";
import { t } from "../texts.js";
import { begin } from "./inspect.js";

export async function show(page, _, signal) {
  if (store.running) return to("/job", true);
  const [recipes] = await Promise.all([get("api/recipes", signal).catch(() => []), loadHome(signal)]);
  const artefact = recipes.find((r) => r.kind === "artefact");
  const order = { kind: "calibrate", operator: localStorage.getItem("operator") ?? store.session.user ?? "" };
  const wrong = h("div", {});
  const note = h("p", { class: "note big" }, t("calibrate.note.calibrate"));
  const old = store.home.calibration.number;
  const operator = h("input", { type: "text", id: "c-operator", maxlength: 80, autocomplete: "off", prop: { value: order.operator }, on: { input: (e) => (order.operator = e.target.value.trim()) } });
  const kinds = ["calibrate", ...(old ? ["verify"] : [])].map((value) => ({ value, label: t(`calibrate.${value}`) }));
  add(page, stepper(names(), 0), heading(t("calibrate.title")),
    h("section", { class: "card" }, kinds.length > 1 && segments(t("calibrate.what"), kinds, order.kind, choose), kinds.length > 1 && note,
      h("ol", { class: "todo" }, [artefact ? t("calibrate.mount.named", { name: artefact.title }) : t("calibrate.mount"), t("mount.clean"), t("mount.clear")].map((text) => h("li", {}, text))),
      field(t("inspect.operator"), operator), wrong,
      h("div", { class: "actions" }, button(t("calibrate.start"), (event) => start(event), { kind: "primary go", sign: "play" }))));

  function choose(kind) {
    order.kind = kind;
    note.textContent = t(`calibrate.note.${kind}`);
  }

  function start(event) {
    localStorage.setItem("operator", order.operator);
    return begin(order, event.currentTarget, wrong);
  }
}

export function names() {
  return ["mount", "measure", "verdict"].map((name) => t(`step.${name}`));
}
