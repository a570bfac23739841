// Home: may one inspect, until when, what came out last, and two buttons large enough for gloves.

import { loadHome } from "../api.js";
import { add, h, put } from "../dom.js";
import { distance, when } from "../format.js";
import { sentence } from "../lines.js";
import { judged, mark } from "../marks.js";
import { empty, heading, link, rows } from "../parts.js";
import { store } from "../store.js";
import { t } from "../texts.js";

export async function show(page, _, signal) {
  await loadHome(signal);
  const state = h("div", { class: "state" });
  const last = h("section", { class: "card last", "aria-labelledby": "last-title" });
  add(page, h("div", { class: "unseen" }, heading(t("home.title"))), state, last);
  draw();
  store.on("home", draw, signal);

  function draw() {
    put(state, calibration(store.home.calibration), h("div", { class: "tasks" }, tasks()));
    put(last, h("h2", { id: "last-title" }, t("home.last")),
      store.home.last.length ? rows(store.home.last) : empty(t("home.nothing")),
      store.home.last.length > 0 && link(t("home.all"), "/results", { kind: "quiet", sign: "next" }));
  }
}

/** The state of the stand, in words that fill the screen. */
function calibration(c) {
  const { tone } = judged(c.state);
  return h("section", { class: `stamp ${tone}` }, mark(tone, "huge"),
    h("div", {}, h("p", { class: "over" }, t("home.stand")), h("h2", { class: "word" }, t(`calibration.${c.state}`)), h("div", { class: "under" }, until(c))));
}

function until(c) {
  const lines = [];
  const words = c.state === "expired" ? "home.until.past" : "home.until.yet";
  const verdict = c.state === "does_not_hold" || c.state === "undecided";
  if (verdict) lines.push(h("p", { class: "until" }, t("home.verified", { time: when(c.verified), distance: distance(c.verified) })));
  else if (c.valid_until) lines.push(h("p", { class: "until" }, t(words, { time: when(c.valid_until), distance: distance(c.valid_until) })));
  else if (c.state === "valid") lines.push(h("p", { class: "until" }, t("home.until.open")));
  if (c.state === "none") lines.push(h("p", {}, t("home.never")));
  for (const reason of [...c.reasons, ...c.changes]) lines.push(h("p", {}, sentence(reason)));
  if (c.not_in_force) lines.push(h("p", {}, h("a", { class: "plain", href: `#/results/${c.not_in_force}` }, t("home.not_in_force", { number: c.not_in_force, why: c.not_in_force_reason }))));
  const from = verdict ? c.verification : c.number;
  if (from) lines.push(h("p", {}, h("a", { class: "plain", href: `#/results/${from}` }, t(verdict ? "home.verification" : "home.calibration", { number: from, time: when(c.time) }))));
  return lines;
}

/** What matters now comes first and in colour. */
function tasks() {
  if (store.running) return link(t("job.show"), "/job", { kind: "primary task", sign: "next" });
  const ready = store.home.calibration.state === "valid";
  const tasks = [link(t("home.inspect"), "/inspect", { kind: `task ${ready ? "primary" : ""}`, sign: "inspect" }),
    link(t("home.calibrate"), "/calibrate", { kind: `task ${ready ? "" : "primary"}`, sign: "calibrate" })];
  return ready ? tasks : tasks.reverse();
}
