// Numbers and times as people read them; the same rules as the printed report.

import { t } from "./texts.js";

const NONE = "–";

/** Decimals that two digits of an uncertainty ask for. */
export function places(U, most = 6) {
  if (!Number.isFinite(U) || U <= 0) return Math.min(3, most);
  return Math.min(Math.max(1 - Math.floor(Math.log10(U)), 0), most);
}

/** A number with fixed decimals, a real minus sign and thin spaces; a dash where there is none. */
export function number(value, decimals = 3) {
  if (!Number.isFinite(value)) return NONE;
  const text = value.toFixed(decimals);
  const [whole, rest] = text.replace("-", "").split(".");
  const sign = text.startsWith("-") && Number(text) !== 0 ? "−" : "";
  return sign + whole.replace(/\B(?=(\d{3})+$)/g, "\u2009") + (rest ? `.${rest}` : "");
}

/** A limit as it was written: no more digits than it has. */
export function short(value) {
  return Number.isFinite(value) ? String(Number(value.toPrecision(6))).replace("-", "−") : NONE;
}

/** `value ± U unit`, both to the second digit of U. */
export function withU(value, U, unit, most = 6) {
  if (!Number.isFinite(value)) return t("word.not_measurable");
  const decimals = places(U, most);
  const text = Number.isFinite(U) ? `${number(value, decimals)} ± ${number(U, decimals)}` : number(value, decimals);
  return unit === "°" ? `${text}°` : `${text} ${unit}`;
}

export function percent(share) {
  return `${Math.floor(100 * share + 1e-9)} %`;
}

/** Day and time of day, in the reader's zone; the year only where it is another one. */
export function when(iso) {
  const time = new Date(iso ?? "");
  if (Number.isNaN(time.getTime())) return NONE;
  const form = { weekday: "short", day: "numeric", month: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23" };
  const year = time.getFullYear() === new Date().getFullYear() ? {} : { year: "numeric" };
  return new Intl.DateTimeFormat(document.documentElement.lang, { ...form, ...year }).format(time);
}

/** How far away a time is: "in 6 days", "2 hours ago". */
export function distance(iso) {
  const seconds = (new Date(iso).getTime() - Date.now()) / 1000;
  const form = new Intl.RelativeTimeFormat(document.documentElement.lang, { numeric: "always" });
  for (const [unit, length] of [["day", 86400], ["hour", 3600], ["minute", 60]])
    if (Math.abs(seconds) >= length) return form.format(Math.trunc(seconds / length), unit);
  return form.format(Math.trunc(seconds), "second");
}
