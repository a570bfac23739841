// Around every page: the stand's name, the way to the other pages, and what must not be missed (fault, job, lost link).

import { loadHome, loadSession, send } from "./api.js";
import { h, put } from "./dom.js";
import { percent } from "./format.js";
import { icon, mark } from "./marks.js";
import { alertBox, ask, button, link } from "./parts.js";
import { to } from "./router.js";
import { store } from "./store.js";
import { t } from "./texts.js";

const PAGES = ["home", "inspect", "calibrate", "results", "history", "devices", "recipes"];
const WITHIN = { result: "results" };

/** Build the frame into `body`; the element that pages go into. */
export function frame(body) {
  const main = h("main", { id: "main" });
  const bars = h("div", { class: "bars" });
  const nav = h("nav", { "aria-label": t("frame.pages") });
  const top = h("header", {});
  put(body, h("a", { class: "skip", href: "#main", on: { click: skip } }, t("frame.skip")), top, nav, h("div", { class: "middle" }, bars, main),
    h("div", { class: "unseen", role: "status", id: "said" }));
  const strips = [fault(), lost(), running()];
  put(bars, strips);
  store.on("session", () => head(top));
  for (const event of ["session", "page", "job"]) store.on(event, () => navigate(nav));
  for (const event of ["home", "job", "page", "connected"]) store.on(event, () => strips.forEach((strip) => strip.draw()));
  head(top);
  navigate(nav);
  return main;
}

/** Say something to those who listen rather than look. */
export function say(text) {
  const said = document.getElementById("said");
  if (said.textContent !== text) said.textContent = text;
}

function skip(event) {
  event.preventDefault();
  document.querySelector("main h1")?.focus();
}

function head(top) {
  const { stand, company, user, role, version } = store.session ?? {};
  put(top, h("a", { class: "brand", href: "#/" }, h("img", { src: "favicon.svg", alt: "", width: 36, height: 36 }),
    h("span", { class: "names" }, h("span", { class: "stand" }, stand || "truestand"), h("span", { class: "company" }, company || ""))),
  h("span", { class: "who" }, user && h("span", { class: "user" }, user), role && h("span", { class: "role" }, t(`role.${role}`)),
    h("span", { class: "version" }, version ? `truestand ${version}` : "")),
  user && role && button(t("action.logout"), logout, { kind: "quiet", sign: "out" }));
}

async function logout() {
  await send("POST", "api/logout").catch(() => {});
  await loadSession().catch(() => {});
  to("/login");
}

function navigate(nav) {
  nav.hidden = !store.session?.role;
  const job = store.page === "job" ? { calibrate: "calibrate", verify: "calibrate", inspect: "inspect" }[store.job?.kind] : null;
  const now = job ?? WITHIN[store.page] ?? store.page;
  put(nav, PAGES.map((name) =>
    h("a", { href: name === "home" ? "#/" : `#/${name}`, "aria-current": name === now ? "page" : null }, icon(name), h("span", {}, t(`page.${name}`)))));
}

/** A strip that draws itself, or is gone. */
function strip(kind, fill) {
  const bar = h("div", { class: `strip ${kind}`, hidden: true });
  let last = null;
  bar.draw = () => {
    const [key, ...children] = fill() ?? [null];
    if (key === last) return;
    last = key;
    bar.hidden = key === null;
    put(bar, children);
  };
  return bar;
}

function fault() {
  const bar = strip("bad", () => {
    const left = store.home?.not_stopped ?? [];
    bar.classList.toggle("hazard", left.length > 0);
    return store.fault && [store.fault, mark("bad", left.length ? "huge" : ""),
      h("div", {}, left.map((what) => h("p", { class: "left" }, what)), left.length > 0 && h("p", {}, h("strong", {}, t("fault.left"))),
        h("p", {}, h("strong", {}, t("fault.title")), " ", store.fault)), button(t("fault.reset"), reset, { kind: "danger" })];
  });
  bar.setAttribute("role", "alert");
  return bar;
}

async function reset() {
  if (!(await ask(t("fault.ask"), t("fault.look"), t("fault.reset")))) return;
  try {
    await send("POST", "api/reset");
    await loadHome();
    say(t("fault.gone"));
  } catch (wrong) {
    document.querySelector(".bars").append(alertBox(wrong.message));
  }
}

function lost() {
  const bar = strip("open", () => (store.connected && store.reached ? null : ["lost", mark("open"), h("p", {}, t("frame.lost"))]));
  bar.setAttribute("role", "status");
  return bar;
}

/** The job at work, seen from every other page. */
function running() {
  const bar = strip("busy", () => {
    if (!store.running || !store.reached || store.page === "job") return null;
    return [store.job.id, mark("busy"), h("p", {}, h("strong", {}, t(`job.running.${store.job.kind}`)), " ", store.job.title ?? ""),
      h("progress", { max: 1, "aria-label": t("job.progress") }), h("span", { class: "share" }), link(t("job.show"), "/job", { kind: "primary" })];
  });
  const draw = bar.draw;
  bar.draw = () => {
    draw();
    const gauge = bar.querySelector("progress");
    if (!gauge || !store.job) return;
    gauge.value = store.job.done;
    bar.querySelector(".share").textContent = percent(store.job.done);
  };
  return bar;
}
