// What several parts of the page know together, and who wants to hear of a change.

const listeners = new Map();

export const store = {
  session: null,
  home: null,
  fault: null,
  job: null,
  live: null,
  connected: true,

  /** Call `act` on each change of `name`, until `signal` aborts. */
  on(name, act, signal) {
    const acts = listeners.get(name) ?? new Set();
    listeners.set(name, acts.add(act));
    signal?.addEventListener("abort", () => acts.delete(act), { once: true });
  },

  tell(name) {
    for (const act of [...(listeners.get(name) ?? [])]) act();
  },

  get running() {
    return this.job?.state === "running";
  },

  get engineer() {
    return this.session?.role === "engineer";
  },
};
