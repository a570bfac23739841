// A job at work: steps, the live profile, the table, and one large button that stops it. Then its verdict.

import { get, loadHome, send } from "../api.js";
import { add, h, put, s } from "../dom.js";
import { number, percent } from "../format.js";
import { say } from "../frame.js";
import { judged, mark, standing } from "../marks.js";
import { alertBox, button, empty, heading, link, stamp, stepper } from "../parts.js";
import { profileView } from "../profile.js";
import { store } from "../store.js";
import { t } from "../texts.js";
import { decisive } from "../lines.js";
import { names as calibrationSteps } from "./calibrate.js";
import { names as inspectionSteps } from "./inspect.js";

const ASK_AGAIN_MS = 2000;
const TONES = { waiting: "none", running: "busy", done: "good", failed: "bad" };

export async function show(page, _, signal) {
  if (!store.home || !store.job) await loadHome(signal);
  if (!store.job) {
    add(page, heading(t("job.title")), empty(t("job.none"), link(t("page.home"), "/", { kind: "primary" })));
    return;
  }
  let [drawn, watched] = [null, false];
  await draw();
  store.on("job", draw, signal);
  store.onChange(() => store.running || ended(page, watched, signal), signal);

  function draw() {
    const key = `${store.job.id} ${store.job.state}`;
    if (key === drawn) return;
    drawn = key;
    if (!store.running) return ended(page, watched, signal);
    watched = true;
    delete page.dataset.ended;
    return put(page, working(signal));
  }
}

function guide(job, at) {
  return job.kind === "inspect" ? stepper(inspectionSteps(), 3 + at) : stepper(calibrationSteps(), 1 + at);
}

function working(signal) {
  const job = store.job;
  const share = h("span", { class: "share" });
  const gauge = h("progress", { max: 1, "aria-label": t("job.progress") });
  const steps = h("ol", { class: "steps" });
  const message = h("p", { class: "note" });
  const wrong = h("div", {});
  const stop = button(t("job.abort"), abort, { kind: "danger stop", sign: "stop" });
  const sensors = h("div", { class: "sensors" });
  const table = dial();
  const views = new Map();
  const unknown = stamp(judged("unknown"), null, t("job.unknown"), "h2");
  const known = h("div", { class: "working" },
    h("section", { class: "card control", "aria-label": t("job.progress") }, h("div", { class: "gauge" }, share, gauge), steps, message, wrong, stop),
    h("section", { class: "card seen", "aria-label": t("live.title") }, table.element, sensors));
  drawReached();
  drawJob();
  drawLive();
  store.on("job", drawJob, signal);
  store.on("live", drawLive, signal);
  store.on("connected", drawReached, signal);
  return [guide(job, 0), heading(title(job)), unknown, known];

  /** What was known last is not shown as if it still were so. */
  function drawReached() {
    known.hidden = !store.reached;
    unknown.hidden = store.reached;
    if (!store.reached) say(t("job.unknown"));
  }

  function drawJob() {
    if (!store.running) return;
    drawShare();
    message.textContent = store.job.message ?? "";
    const key = store.job.steps.map((step) => step.state).join();
    if (steps.dataset.key === key) return;
    steps.dataset.key = key;
    put(steps, store.job.steps.map(stepLine));
    const now = store.job.steps.find((step) => step.state === "running");
    if (now) say(t("job.now", { step: now.label }));
  }

  function drawShare() {
    const done = doneOf(store.job, store.live);
    share.textContent = percent(done);
    gauge.value = done;
  }

  function drawLive() {
    drawShare();
    table.turn(store.live?.position_deg);
    for (const sensor of store.live?.sensors ?? []) {
      if (!views.has(sensor.name)) {
        views.set(sensor.name, sensorView(sensor.name));
        sensors.append(views.get(sensor.name).element);
      }
      views.get(sensor.name).draw(sensor);
    }
    sensors.classList.toggle("waiting", views.size === 0);
    sensors.dataset.count = views.size;
    if (!views.size && !sensors.firstChild) sensors.append(h("p", { class: "note" }, t("live.waiting")));
    if (views.size) sensors.querySelector(":scope > .note")?.remove();
  }

  async function abort() {
    stop.disabled = true;
    stop.querySelector("span").textContent = t("job.aborting");
    try {
      await send("POST", `api/jobs/${encodeURIComponent(store.job.id)}/abort`);
    } catch (refused) {
      put(wrong, alertBox(refused.message));
      stop.disabled = false;
      stop.querySelector("span").textContent = t("job.abort");
    }
  }
}

/** The steps that are done, and as much of the scan as has come. */
function doneOf({ done, steps }, live) {
  const at = steps.findIndex((step) => step.state === "running");
  const scanned = at >= 0 && live?.step === steps[at].name ? (at + live.done) / steps.length : 0;
  return Math.min(1, Math.max(done, scanned));
}

function stepLine(step) {
  return h("li", { class: step.state }, mark(TONES[step.state] ?? "none"), h("span", {}, step.label), h("span", { class: "unseen" }, t(`step.state.${step.state}`)));
}

/** Where the table stands, as a dial. */
function dial() {
  const hand = s("line", { x1: 50, y1: 50, x2: 50, y2: 12, class: "hand" });
  const reading = h("strong", {}, "–");
  const element = h("div", { class: "dial" }, s("svg", { viewBox: "0 0 100 100", "aria-hidden": "true" }, s("circle", { cx: 50, cy: 50, r: 44 }), hand, s("circle", { cx: 50, cy: 50, r: 5, class: "hub" })),
    h("div", {}, h("span", { class: "label" }, t("live.table")), reading));
  return {
    element,
    turn(degrees) {
      if (!Number.isFinite(degrees)) return;
      hand.setAttribute("transform", `rotate(${-degrees} 50 50)`);
      reading.textContent = `${number(degrees, 1)}°`;
    },
  };
}

function sensorView(name) {
  const view = profileView(name);
  const [rate, profiles, lost] = ["rate", "profiles", "lost"].map((key) => h("dd", { class: key }));
  const element = h("section", { class: "sensor" }, h("h2", {}, name), view.element,
    h("dl", { class: "tiles" }, h("div", {}, h("dt", {}, t("live.rate")), rate), h("div", {}, h("dt", {}, t("live.profiles")), profiles), h("div", {}, h("dt", {}, t("live.lost")), lost)));
  return {
    element,
    draw(sensor) {
      rate.textContent = number(sensor.frames_per_s, 0);
      profiles.textContent = number(sensor.profiles, 0);
      lost.textContent = `${number(sensor.lost, 0)} ${sensor.lost ? "✗" : "✓"}`;
      lost.classList.toggle("bad", sensor.lost > 0);
      if (sensor.profile) view.draw(sensor.profile);
    },
  };
}

/** The end: huge, what decided it, and where to go from here. It takes the keyboard where the job was `watched`. */
async function ended(page, watched, signal) {
  const job = store.job;
  const result = job.number && (await get(`api/results/${job.number}`, signal).catch(() => null));
  if (signal.aborted || store.job.id !== job.id) return; // the next job may have begun
  if (job.number && !result) setTimeout(() => signal.aborted || ended(page, watched, signal), ASK_AGAIN_MS);
  const key = JSON.stringify([job.id, result?.entry]);
  if (page.dataset.ended === key) return;
  const takesFocus = (watched && !page.dataset.ended) || page.contains(document.activeElement);
  page.dataset.ended = key;
  const over = [title(job), result?.entry.serial].filter(Boolean).join(" · ");
  put(page, guide(job, 1), stamp(outcome(job, result), over, job.message),
    result && h("div", { class: "why" }, decisive(result.entry, result.record)), h("div", { class: "actions large" }, onward(job)));
  say(`${title(job)}: ${page.querySelector(".word").textContent}`);
  if (!takesFocus) return;
  page.querySelector("h1")?.setAttribute("tabindex", "-1");
  page.querySelector("h1")?.focus();
}

/** What came of a job. A result counts as what it is worth: it may rest on a calibration that is in doubt. */
function outcome(job, result) {
  if (result) return standing(result.entry);
  const said = judged(job.state === "done" ? (job.verdict ?? job.status ?? "done") : job.state);
  return job.number ? { ...said, tone: "none" } : said;
}

function onward(job) {
  const details = job.number && link(t("job.details"), `/results/${job.number}`, { kind: job.state === "done" ? "" : "primary", sign: "results" });
  if (job.kind === "inspect") {
    const again = `/inspect/${encodeURIComponent(job.part)}`;
    return [link(t(job.state === "done" ? "job.next_part" : "job.again"), again, { kind: "primary", sign: job.state === "done" ? "next" : "again" }), details, link(t("page.home"), "/", { sign: "home" })];
  }
  const trusted = ["valid", "holds"].includes(job.verdict ?? job.status);
  const calibrate = job.state === "done" ? link(t("home.calibrate"), "/calibrate", { kind: "primary", sign: "calibrate" }) : link(t("job.again"), "/calibrate", { kind: "primary", sign: "again" });
  return [trusted ? link(t("home.inspect"), "/inspect", { kind: "primary", sign: "inspect" }) : calibrate,
    details, link(t("page.home"), "/", { sign: "home" })];
}

function title(job) {
  return job.title ? `${t(`job.${job.kind}`)}: ${job.title}` : t(`job.${job.kind}`);
}
