// The live channel: jobs and profiles as they come. While it is down, the job is asked for every two seconds.

import { get, loadHome } from "./api.js";
import { store } from "./store.js";

const POLL = 2000;
const WAITS = [500, 1000, 2000, 4000];
let socket = null;
let failures = 0;
let polling = null;
let retry = null;

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
    }, WAITS[Math.min(failures++, WAITS.length - 1)]);
  });
}

function connected(yes) {
  if (yes) failures = 0;
  if (yes) clearInterval(polling);
  if (yes && !store.connected) take(null, true);
  polling = yes ? null : (polling ?? setInterval(poll, POLL));
  if (store.connected === yes) return;
  store.connected = yes;
  store.tell("connected");
}

async function poll() {
  const job = await get("api/jobs/current").catch(() => undefined);
  if (job !== undefined) take(job);
}

function heard(event) {
  if (event.type === "job") take(event.job);
  if (event.type !== "live") return;
  store.live = { ...event.live, step: store.job?.step };
  store.tell("live");
}

/** A job as it is now. Home is asked anew when it ends: verdicts, calibration and fault may have changed. */
export function take(job, unsure = false) {
  const before = store.job;
  if (job && job.id !== before?.id) store.live = null;
  if (job) store.job = job;
  if (job) store.tell("job");
  const ended = before?.state === "running" && job && job.state !== "running";
  if (ended || unsure) loadHome().catch(() => {});
}
