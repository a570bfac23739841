// What several parts of the page know together, and who wants to hear of a change.

import { t } from "./texts.js";

const listeners = new Map();

export const store = {
  session: null,
  home: null,
  fault: null,
  job: null,
  live: null,
  /** How often the live channel has told of a job. */
  told: 0,
  connected: true,
  /** Whether the server answered when it was last asked. */
  reached: true,

  /** Call `act` on each change of `name`, until `signal` aborts. */
  on(name, act, signal) {
    const acts = listeners.get(name) ?? new Set();
    listeners.set(name, acts.add(act));
    signal?.addEventListener("abort", () => acts.delete(act), { once: true });
  },

  /** Call `act` whenever the stand, its store or its recipes have changed, by whatever program. */
  onChange(act, signal) {
    let known = this.home?.version;
    this.on("home", () => {
      if (this.home.version === known) return;
      known = this.home.version;
      act();
    }, signal);
  },

  notify(name) {
    for (const act of [...(listeners.get(name) ?? [])]) act();
  },

  /**
   * What the server says of the job, asked for when the live channel had `told` so much: what that has told since is
   * newer. A job that the server no longer knows ended with the server that ran it.
   */
  know(job, told = this.told) {
    if (told < this.told) return;
    if (job) this.job = job;
    else if (this.running) this.job = { ...this.job, state: "ended", message: t("job.ended") };
  },

  get running() {
    return this.job?.state === "running";
  },

  get engineer() {
    return this.session?.role === "engineer";
  },
};
