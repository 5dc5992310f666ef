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
  if (!answer.ok) {
    const text = await answer.text();
    let sentence = text;
    try { sentence = JSON.parse(text).sentence ?? text; } catch { /* it was plain text */ }
    throw new Error(sentence);
  }
  return answer.json();
}

export const post = (path, body) =>
  ask(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });

/** The same work, with what goes wrong said on the page. */
export const tried = (work) => async (...given) => {
  try { return await work(...given); } catch (error) { say(error.message, true); return undefined; }
};

export const names = (text) => text.split(",").map((one) => one.trim()).filter(Boolean);

export function number(value, digits = 4) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (value !== 0 && (size >= 1e6 || size < 1e-4)) return value.toExponential(digits - 1).replaceAll("-", "−");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}

export const counted = (count, one, many = `${one}s`) => `${count} ${count === 1 ? one : many}`;

/** A value with half the width of its interval, as many digits as the width allows. */
export function within(one) {
  if (!one || one.value === null || one.value === undefined) return "–";
  const half = one.upper !== null && one.lower !== null && one.upper !== undefined ? (one.upper - one.lower) / 2 : null;
  if (!half) return number(one.value);
  const places = Math.min(Math.max(1 - Math.floor(Math.log10(half)), 0), 10);
  return `${one.value.toFixed(places)} ± ${half.toFixed(places)}`.replaceAll("-", "−");
}

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
