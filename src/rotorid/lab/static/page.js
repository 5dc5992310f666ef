// Elements, numbers as text, and questions to the server.
export const $ = (id) => document.getElementById(id);

export function make(tag, text = "", attributes = {}, ...children) {
  const one = document.createElement(tag);
  one.textContent = text;
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) one.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) one.setAttribute(name, value === true ? "" : value);
  }
  one.append(...children);
  return one;
}

export function say(text, bad = false) {
  $("message").textContent = text;
  $("message").className = bad ? "bad" : "";
}

export async function ask(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { cache: "no-store", ...options });
  } catch {
    throw new Error("The server does not answer: it was ended, or its terminal was closed. Start rotorid lab again.");
  }
  if (!answer.ok) throw new Error(sentenceOf(await answer.text()));
  return answer.json();
}

/** What a refusal says: JSON with a sentence, or plain text. */
export function sentenceOf(text) {
  try { return JSON.parse(text).sentence ?? text; } catch { return text; }
}

export const post = (path, body) =>
  ask(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });

/** What somebody asked for: what was said before goes away, and what goes wrong is said. */
export const tried = (work) => async (...given) => {
  say("");
  try { return await work(...given); } catch (error) { say(error.message, true); return undefined; }
};

/** What the page does by itself: it says what goes wrong, and takes back only that. */
export const watched = (work) => {
  let said = "";
  return async (...given) => {
    try {
      const found = await work(...given);
      if (said && $("message").textContent === said) say("");
      said = "";
      return found;
    } catch (error) {
      say((said = error.message), true);
      return undefined;
    }
  };
};

/** Words of a command line as a shell reads them. */
export const shellWords = (words) =>
  words.map((word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`)).join(" ");

/** Draw a list anew; the focus stays on what carries the same `data-key`, or goes to `otherwise`. */
export function redrawn(box, children, otherwise = null) {
  const held = box.contains(document.activeElement) ? document.activeElement : null;
  box.replaceChildren(...children);
  if (!held) return;
  const same = held.dataset.key && box.querySelector(`[data-key="${CSS.escape(held.dataset.key)}"]`);
  (same || otherwise)?.focus({ preventScroll: true });
}

/** What is kept in this browser, as far as it keeps anything. */
export const kept = (store, key) => { try { return window[store].getItem(key); } catch { return null; } };
export const keep = (store, key, text) => { try { window[store].setItem(key, text); } catch { /* it is kept on the page alone */ } };

export const names = (text) => text.split(",").map((one) => one.trim()).filter(Boolean);

export function number(value, digits = 4) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (value !== 0 && (size >= 1e6 || size < 1e-4)) return value.toExponential(digits - 1).replaceAll("-", "−");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}

const SIGNS = Object.fromEntries([..."-0123456789"].map((sign, k) => [sign, "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"[k]]));
export const raised = (power) => [...String(power)].map((sign) => SIGNS[sign]).join("");
/** A unit as it is read: nothing for plain numbers, powers as such. */
export const unitOf = (unit) =>
  unit === "1" ? "" : unit.replace(/\^(-?\d+)/g, (_, power) => raised(power)).replaceAll("*", "·");

/** Whether angles and rates of channels are shown in degrees; what is sent and kept is in radians all the same. */
export const angles = { degrees: false };
/** The unit in which a channel is shown, and what its values are multiplied by. */
export const seenAs = (unit) =>
  angles.degrees && /^rad($|\/s)/.test(unit) ? { unit: unit.replace(/^rad/, "deg"), factor: 180 / Math.PI } : { unit, factor: 1 };
/** Values of a channel, in what they are shown in. */
export const times = (values, factor) => (factor === 1 ? values : values.map((value) => (value === null ? null : value * factor)));

const ENDINGS = { rad_s: () => unitText(), deg: () => "deg", db: () => "dB", s: () => "s", percent: () => "%" };
/** The words of a key such as `gain_margin_db`: what it is, and in which unit. */
export function words(key) {
  const [, name, ending] = /^(.*?)(?:_(rad_s|deg|db|s|percent))?$/.exec(key);
  return `${name.replaceAll("_", " ")}${ending ? ` in ${ENDINGS[ending]()}` : ""}`;
}

export const counted = (count, one, many = `${one}s`) => `${count} ${count === 1 ? one : many}`;

const halfOf = (one) => (Number.isFinite(one.upper) && Number.isFinite(one.lower) ? (one.upper - one.lower) / 2 : 0);
/** A number as an interval of this half width tells it: one digit of the width, two of one that begins with 1 or 2. */
export function told(value, half) {
  if (value === null || value === undefined || !half) return number(value);
  const power = Math.floor(Math.log10(half)), places = Math.max((half / 10 ** power < 3 ? 1 : 0) - power, 0);
  return places > 10 ? number(value) : value.toFixed(places).replaceAll("-", "−");
}
/** A value with half the width of its interval, as many digits as the width allows. */
export function within(one) {
  if (!one || one.value === null || one.value === undefined) return "–";
  const half = halfOf(one);
  return half ? `${told(one.value, half)} ± ${told(half, half)}` : number(one.value);
}
/** A value and the ends of its interval, as many digits as its width allows. */
export const ends = (one) => [one.value, one.lower, one.upper].map((value) => told(value, halfOf(one)));
/** A value with its interval, of a value and its standard deviation. */
export const withStd = (value, std) => within({ value, lower: value - 1.96 * std, upper: value + 1.96 * std });

export function tableOf(caption, heads, rows) {
  const table = make("table", "", {}, ...(caption ? [make("caption", caption)] : []));
  table.append(make("thead", "", {}, make("tr", "", {}, ...heads.map((one) => make("th", one, { scope: "col" })))));
  table.append(make("tbody", "", {}, ...rows.map((row) => make("tr", "", {}, ...row.map((one, k) => {
    const cell = k ? make("td", "", { class: "n" }) : make("th", "", { scope: "row" });
    cell.append(one);
    return cell;
  })))));
  return make("div", "", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption || heads.join(", ") }, table);
}

const RADIANS = 2 * Math.PI;
export const inHz = () => $("units").value === "hz";
export const shownOmega = (omega) => (inHz() ? omega / RADIANS : omega);
export const omegaOf = (shown) => (inHz() ? shown * RADIANS : shown);
export const unitText = () => (inHz() ? "Hz" : "rad/s");
/** An estimate in rad/s, in the unit that was chosen. */
export const shownRate = (one) =>
  one && inHz() ? { value: one.value / RADIANS, lower: one.lower === null ? null : one.lower / RADIANS, upper: one.upper === null ? null : one.upper / RADIANS } : one;
