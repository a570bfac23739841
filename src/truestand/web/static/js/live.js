// The live channel: jobs and profiles as they come. While it is down, or silent though a job runs, the job is asked for.

import { get, loadHome } from "./api.js";
import { store } from "./store.js";

const POLL_INTERVAL_MS = 2000;
const SILENCE_MS = 5000;
const ANSWER_TIMEOUT_MS = 4000;
const RECONNECT_DELAYS_MS = [500, 1000, 2000, 4000];
let socket = null;
let failures = 0;
let retry = null;
let heardAt = 0;
setInterval(poll, POLL_INTERVAL_MS);

/** Open the channel, once; it reopens itself for ever. */
export function listen() {
  if (socket || retry) return;
  const address = new URL("api/live", document.baseURI);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(address);
  socket.addEventListener("open", () => connected(true));
  socket.addEventListener("message", (event) => heard(JSON.parse(event.data)));
  socket.addEventListener("close", () => {
    socket = null;
    if (!store.session?.role) return;
    connected(false);
    retry = setTimeout(() => {
      retry = null;
      listen();
    }, RECONNECT_DELAYS_MS[Math.min(failures++, RECONNECT_DELAYS_MS.length - 1)]);
  });
}

function connected(yes) {
  if (yes) failures = 0;
  if (yes) reached(true);
  if (yes && !store.connected) loadHome().catch(() => {});
  if (store.connected === yes) return;
  store.connected = yes;
  store.notify("connected");
}

/** A connection whose other end is gone may stay open for minutes: where nothing comes from it, ask. */
async function poll() {
  if (!store.session?.role || (store.connected && !(store.running && Date.now() - heardAt > SILENCE_MS))) return;
  try {
    const { told } = store;
    take(await get("api/jobs/current", AbortSignal.timeout(ANSWER_TIMEOUT_MS)), told);
    reached(true);
  } catch (wrong) {
    reached(wrong.status !== 0);
  }
}

function reached(yes) {
  if (store.reached === yes) return;
  store.reached = yes;
  store.notify("connected");
}

function heard(event) {
  heardAt = Date.now();
  if (event.type === "job") take(event.job, ++store.told);
  if (event.type === "home" && store.home && store.home.version !== event.version) loadHome().catch(() => {});
  if (event.type !== "live") return;
  store.live = { ...event.live, step: store.job?.step };
  store.notify("live");
}

/** A job as it is now. Home is asked anew when it ends: verdicts, calibration and fault may have changed. */
function take(job, told) {
  const before = store.job;
  store.know(job, told);
  if (store.job?.id !== before?.id) store.live = null;
  store.notify("job");
  if (before?.state === "running" && !store.running) loadHome().catch(() => {});
}
