// The stand's REST interface: JSON in, JSON out, every refusal a Problem with words for people.

import { store } from "./store.js";
import { t } from "./texts.js";

/** What the server refused, in its words; status 0 = it did not answer. */
export class Problem extends Error {
  constructor(status, text) {
    super(text);
    this.status = status;
  }
}

export async function get(path, signal) {
  return (await ask(path, { signal })).json();
}

export async function getBytes(path, signal) {
  return (await ask(path, { signal })).arrayBuffer();
}

/** POST, PUT or DELETE with the session's token. A token that went stale is fetched again, once. */
export async function send(method, path, body = {}) {
  try {
    return await (await write(method, path, body)).json();
  } catch (problem) {
    const before = store.session?.csrf;
    if (problem.status !== 403) throw problem;
    await loadSession();
    if (store.session.csrf === before) throw problem;
    return (await write(method, path, body)).json();
  }
}

export async function loadSession() {
  store.session = await get("api/session");
  store.notify("session");
  return store.session;
}

export async function loadHome(signal) {
  const { told } = store;
  store.home = await get("api/home", signal);
  store.fault = store.home.fault;
  store.know(store.home.job, told);
  store.notify("home");
  store.notify("job");
  return store.home;
}

function write(method, path, body) {
  const headers = { "Content-Type": "application/json", "X-CSRF-Token": store.session?.csrf ?? "" };
  return ask(path, { method, headers, body: JSON.stringify(body) });
}

async function ask(path, how) {
  let answer;
  try {
    answer = await fetch(path, { credentials: "same-origin", ...how });
  } catch (wrong) {
    if (wrong.name === "AbortError") throw wrong;
    throw new Problem(0, t("problem.unreachable"));
  }
  if (answer.ok) return answer;
  const body = await answer.json().catch(() => ({}));
  if (answer.status === 401 && path !== "api/login") store.notify("login");
  throw new Problem(answer.status, body.problem ?? t("problem.status", { status: answer.status }));
}
