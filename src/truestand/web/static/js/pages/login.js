// Who is at the stand.

import { loadSession, send } from "../api.js";
import { add, h, put } from "../dom.js";
import { alertBox, button, field } from "../parts.js";
import { store } from "../store.js";
import { t } from "../texts.js";

export async function show(page) {
  const user = h("input", { type: "text", id: "user", autocomplete: "username", required: true, autocapitalize: "none", spellcheck: "false" });
  const password = h("input", { type: "password", id: "password", autocomplete: "current-password", required: true });
  const wrong = h("div", {});
  const enter = button(t("login.enter"), null, { kind: "primary", type: "submit" });
  add(page, h("form", { class: "card form login", on: { submit } }, h("h1", {}, t("login.title", { stand: store.session?.stand || "truestand" })),
    field(t("login.user"), user), field(t("login.password"), password), wrong, h("div", { class: "actions" }, enter)));

  async function submit(event) {
    event.preventDefault();
    enter.disabled = true;
    try {
      await send("POST", "api/login", { user: user.value.trim(), password: password.value });
      await loadSession();
    } catch (refused) {
      put(wrong, alertBox(refused.message));
      password.value = "";
      password.focus();
    } finally {
      enter.disabled = false;
    }
  }
}

export function shown(page) {
  page.querySelector("#user").focus();
}
