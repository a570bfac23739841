// Start: texts, session, frame, then the page of the address.

import { loadHome, loadSession } from "./api.js";
import { frame } from "./frame.js";
import { listen } from "./live.js";
import { go, here, route, to } from "./router.js";
import { store } from "./store.js";
import { loadTexts } from "./texts.js";

let back = "/";

async function begin() {
  const texts = loadTexts();
  const session = loadSession().catch((wrong) => wrong);
  await texts;
  await session;
  store.on("login", askLogin);
  store.on("session", entered);
  const main = frame(document.body);
  if (store.session?.login_needed) return askLogin(), route(main);
  await Promise.all([route(main), here() === "/" ? null : loadHome().catch(() => {})]);
  performance.mark("truestand:view");
  entered();
  return undefined;
}

/** To the login, and afterwards back to where one was. */
function askLogin() {
  if (here() === "/login") return;
  back = here();
  to("/login", true);
}

/** Someone is in: listen to the stand. */
function entered() {
  if (!store.session?.role) return;
  listen();
  if (here() === "/login") to(back, true);
}

addEventListener("online", () => go());
begin();
