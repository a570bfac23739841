// Inspect, guided: choose the part, say which one it is, mount it, go. The job page takes over from there.

import { get, loadHome, send } from "../api.js";
import { add, h, put } from "../dom.js";
import { when } from "../format.js";
import { sentence } from "../lines.js";
import { icon, judged, mark } from "../marks.js";
import { alertBox, button, empty, field, heading, link, stepper } from "../parts.js";
import { to } from "../router.js";
import { store } from "../store.js";
import { t } from "../texts.js";

/** What was entered about the part so far; the operator and the order stay for the next one. */
const entered = { part: null, serial: "", order: "", operator: null };

export const STEPS = ["choose", "identify", "mount", "measure", "verdict"];

export async function show(page, { part, step }, signal) {
  await loadHome(signal);
  if (store.running) return to("/job", true);
  if (!part) return choose(page, signal);
  const parts = await get("api/parts", signal);
  const chosen = parts.find((p) => p.name === part);
  if (!chosen) return to("/inspect", true);
  return step === "mount" ? mount(page, chosen, signal) : identify(page, chosen);
}

async function choose(page, signal) {
  const parts = await get("api/parts", signal);
  const list = parts.length
    ? h("ul", { class: "choices" }, parts.map((p) => h("li", {}, choice(p))))
    : empty(t("inspect.no_parts"), store.engineer && link(t("inspect.write_recipe"), "/recipes", { kind: "primary" }));
  add(page, stepper(names(), 0), heading(t("inspect.choose")), warning(signal), list);
}

function choice(part) {
  return h("a", { class: "choice", href: `#/inspect/${encodeURIComponent(part.name)}` }, icon(part.kind),
    h("span", { class: "name" }, part.title || part.name), h("span", { class: "facts" }, `${t(`part.${part.kind}`)} · ${part.file}`));
}

/** Nothing can be decided on a stand that is not calibrated: shown before the work, and as soon as it is so. */
function warning(signal) {
  const place = h("div", { class: "warning" });
  const draw = () => {
    const shown = notice();
    place.hidden = !shown;
    put(place, shown);
  };
  draw();
  store.onChange(draw, signal);
  return place;
}

function notice() {
  const { state, verified, reasons, changes } = store.home.calibration;
  if (state === "valid") return null;
  const { tone } = judged(state);
  return h("div", { class: `notice ${tone}`, role: "alert" }, mark(tone),
    h("div", {}, h("p", {}, t(`inspect.warning.${state}`, { time: when(verified) })), [...reasons, ...changes].map((reason) => h("p", {}, sentence(reason)))),
    link(t("home.calibrate"), "/calibrate", { kind: "primary go", sign: "calibrate" }));
}

function identify(page, part) {
  if (entered.part !== part.name) Object.assign(entered, { part: part.name, serial: "" });
  entered.operator ??= localStorage.getItem("operator") ?? store.session.user ?? "";
  const input = (key, more = {}) => h("input", { type: "text", id: `i-${key}`, maxlength: 80, autocomplete: "off", spellcheck: "false", prop: { value: entered[key] }, on: { input: (e) => (entered[key] = e.target.value.trim()) }, ...more });
  const form = h("form", { class: "card form identify", on: { submit: onward } },
    field(t("inspect.serial"), input("serial"), t("inspect.serial.note")), field(t("inspect.order"), input("order")), field(t("inspect.operator"), input("operator")),
    h("div", { class: "actions" }, link(t("action.back"), "/inspect", { sign: "back" }), button(t("action.next"), null, { kind: "primary", type: "submit", sign: "next" })));
  add(page, stepper(names(), 1), heading(part.title || part.name), h("p", { class: "lead" }, t("inspect.identify")), form);

  function onward(event) {
    event.preventDefault();
    localStorage.setItem("operator", entered.operator);
    to(`/inspect/${encodeURIComponent(part.name)}/mount`);
  }
}

function mount(page, part, signal) {
  if (entered.part !== part.name) return to(`/inspect/${encodeURIComponent(part.name)}`, true);
  const wrong = h("div", {});
  const go = button(t("inspect.start"), start, { sign: "play" });
  ready();
  store.onChange(ready, signal);
  add(page, stepper(names(), 2), heading(t("inspect.mount")), warning(signal),
    h("section", { class: "card" }, h("dl", { class: "facts-list" }, fact(t("inspect.part"), part.title || part.name),
      fact(t("inspect.serial"), entered.serial), fact(t("inspect.order"), entered.order), fact(t("inspect.operator"), entered.operator)),
    h("ol", { class: "todo" }, ["mount.part", "mount.clean", "mount.clear"].map((key) => h("li", {}, t(key)))), wrong,
    h("div", { class: "actions" }, link(t("action.back"), `/inspect/${encodeURIComponent(part.name)}`, { sign: "back" }),
      go)));

  function ready() {
    for (const kind of ["primary", "go"]) go.classList.toggle(kind, store.home.calibration.state === "valid");
  }

  function start(event) {
    return begin({ kind: "inspect", part: part.name, serial: entered.serial, order: entered.order, operator: entered.operator }, event.currentTarget, wrong);
  }
}

/** Start a job and show its page; a refusal is shown beside the button. */
export async function begin(order, pressed, wrong) {
  pressed.disabled = true;
  try {
    const { told } = store;
    store.know(await send("POST", "api/jobs", order), told);
    store.live = null;
    store.notify("job");
    if (order.kind === "inspect") entered.serial = "";
    to("/job");
  } catch (refused) {
    put(wrong, alertBox(refused.message));
    pressed.disabled = false;
    pressed.focus();
  }
}

export function names() {
  return STEPS.map((name) => t(`step.${name}`));
}

function fact(name, value) {
  return [h("dt", {}, name), h("dd", {}, value || "–")];
}
