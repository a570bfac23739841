// Modules that are loaded when first wanted. One that did not come, because the server was away, browsers do not ask for
// again: only loading the whole page anew helps.

import { Problem } from "./api.js";
import { store } from "./store.js";
import { t } from "./texts.js";

/** The module of a path below js/. */
export async function load(path) {
  try {
    return await import(`./${path}`);
  } catch (wrong) {
    if (!(wrong instanceof TypeError)) throw wrong;
    throw Object.assign(new Problem(0, t("problem.unreachable")), { stale: true });
  }
}

/** What tries again after the server did not answer. */
export function retry(wrong, again) {
  return wrong.stale ? () => location.reload() : again;
}

/** Try again by itself as soon as the server answers, until `signal` aborts. */
export function whenBack(wrong, again, signal) {
  if (wrong.status !== 0) return;
  store.on("connected", () => store.connected && store.reached && retry(wrong, again)(), signal);
}
