// Pages by hash: #/results/12/cloud. Each page is a module, loaded when first wanted.

import { h, put } from "./dom.js";
import { load, retry, whenBack } from "./modules.js";
import { store } from "./store.js";
import { busy, trouble } from "./parts.js";

const ROUTES = [
  [/^\/?$/, "home", []],
  [/^\/inspect$/, "inspect", []],
  [/^\/inspect\/([^/]+)(?:\/(mount))?$/, "inspect", ["part", "step"]],
  [/^\/calibrate$/, "calibrate", []],
  [/^\/job$/, "job", []],
  [/^\/results$/, "results", []],
  [/^\/results\/(\d+)(?:\/(\w+))?$/, "result", ["number", "tab"]],
  [/^\/history(?:\/([^/]+))?(?:\/([^/]+))?$/, "history", ["of", "quantity"]],
  [/^\/devices$/, "devices", []],
  [/^\/recipes(?:\/([^/]+))?$/, "recipes", ["file"]],
  [/^\/login$/, "login", []],
];

let current = null;
let place = null;
let shown = null;
let may = () => true;

/** Start routing into `main`. */
export function route(main) {
  place = main;
  addEventListener("hashchange", go);
  return go();
}

export function here() {
  return location.hash.slice(1) || "/";
}

/** Go to a page; `replace` leaves no way back to this one. */
export function to(path, replace = false) {
  if (path === here()) return go();
  if (!replace) location.hash = path;
  else history.replaceState(null, "", `#${path}`);
  return replace ? go() : undefined;
}

/** Ask before leaving the page that is shown; forgotten with it. */
export function guard(ask) {
  may = ask;
}

/** Show the page again, as after a login. */
export async function go() {
  const path = here();
  if (shown !== null && shown !== path && !may()) return history.replaceState(null, "", `#${shown}`);
  const first = shown === null;
  current?.abort();
  const controller = (current = new AbortController());
  [shown, may] = [path, () => true];
  const [name, values] = match(path);
  const slow = setTimeout(() => put(place, busy()), 250);
  try {
    const page = await load(`pages/${name}.js`);
    const built = h("div", { class: `page ${name}` });
    await page.show(built, values, controller.signal);
    if (controller.signal.aborted) return undefined;
    clearTimeout(slow);
    put(place, built);
    page.shown?.(built, controller.signal);
  } catch (wrong) {
    if (controller.signal.aborted || wrong.name === "AbortError") return undefined;
    clearTimeout(slow);
    put(place, h("div", { class: "page" }, trouble(wrong, retry(wrong, go))));
    whenBack(wrong, go, controller.signal);
  } finally {
    clearTimeout(slow);
  }
  return settle(name, first);
}

/** Title, mark in the navigation, and the keyboard where the new page begins. */
function settle(name, first) {
  const heading = place.querySelector("h1");
  document.title = [heading?.textContent, store.session?.stand, "truestand"].filter(Boolean).join(" · ");
  store.page = name;
  store.notify("page");
  if (!place.querySelector(":focus")) {
    scrollTo(0, 0);
    heading?.setAttribute("tabindex", "-1");
    if (!first) heading?.focus({ preventScroll: true });
  }
}

function match(path) {
  for (const [pattern, name, keys] of ROUTES) {
    const found = pattern.exec(path);
    if (found) return [name, Object.fromEntries(keys.map((key, i) => [key, text(found[i + 1])]))];
  }
  return ["home", {}];
}

function text(piece) {
  return piece === undefined ? undefined : decodeURIComponent(piece);
}

