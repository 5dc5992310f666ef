// The page: what is chosen here becomes a step, a step becomes a command line, and the server runs that.
import { Choices } from "./choices.js";
import { $, angles, ask, counted, keep, kept, make, post, redrawn, sentenceOf, tried, unitText, watched } from "./page.js";
import { isDark } from "./plots.js";
import { Results } from "./results.js";
import { Spectra } from "./spectra.js";
import { Tracks, firstTracks } from "./tracks.js";

const POLL_MS = 350;
const page = { state: { logs: [], steps: [], waiting: [] }, log: 0, told: {}, asked: 0 };
const told = () => page.told[page.log];
const goes = (one) => ["waiting", "running"].includes(one.state);
const isSeen = (log) => Boolean(page.state.logs[log - 1]?.seen);

const choices = new Choices({
  changed: () => { choices.showOthers(page.state.logs); tracks.redraw(); showSpan(); },
  log: () => page.log, told, isOpen: (k) => page.state.logs[k - 1]?.state === "done", isSeen, view: () => tracks.view.map((at) => Number(at.toFixed(3))),
  names: () => page.state.logs.map((one) => one.name), show: (log) => { if (log !== page.log) showLog(log); },
});
const spectra = new Spectra($("spectra"));
const tracks = new Tracks($("tracks"), {
  bands: () => [
    ...(told()?.inspection?.flights ?? []).map((one) => ({ start: one.start_s, stop: one.stop_s, color: "--flight" })),
    ...(told()?.inspection?.excitations ?? []).map((one) => ({ start: one.start_s, stop: one.stop_s, color: "--excitation", label: one.axis })),
  ],
  marks: () => (told()?.inspection?.findings ?? []).filter((one) => one.severity !== "info").map(timeOf).filter((at) => at !== null),
  segments: () => choices.segments,
  brushed: (start, stop) => choices.brushed(start, stop),
  edged: (k, side, at, last) => choices.edged(k, side, at, last),
  unedged: () => choices.forget(),
  viewed: () => showSpan(),
});
const start = tried(async (step) => {
  const { step: number } = await post("/api/steps", step);
  await refresh();
  $(`step-${number}`)?.scrollIntoView({ behavior: "auto", block: "nearest" });
});
const results = new Results({ log: () => page.log, name: (log) => page.state.logs[log - 1]?.name ?? "the log shown", start, band: (band) => { choices.set({ band }); $("more").open = true; }, refresh: () => refresh() });

/** When a finding happened, as far as it has a time. */
function timeOf(finding) {
  const { start_s, first_s, longest_at_s } = finding.numbers;
  return start_s ?? first_s ?? longest_at_s ?? null;
}

// Open
const upload = tried(async (files) => {
  const refused = [];
  for (const file of files) {
    // One that is refused holds up no other.
    try { await sent(file); } catch (error) { refused.push(error.message); }
    await refresh();
  }
  $("taking").hidden = true;
  if (refused.length) throw new Error(refused.join(" "));
});

/** Send a file to the server, and show how much of it is there: only the older kind of request tells. */
const sent = (file) => new Promise((done, fail) => {
  const request = new XMLHttpRequest(), [text, bar] = $("taking").children;
  $("taking").hidden = false;
  text.textContent = `taking in ${file.name}`;
  bar.value = 0;
  request.upload.addEventListener("progress", ({ loaded, total }) => {
    bar.value = loaded / Math.max(total, 1);
    text.textContent = `taking in ${file.name}: ${mebibytes(loaded)} of ${mebibytes(total)} MiB`;
  });
  request.addEventListener("load", () => {
    if (request.status < 400) done();
    else fail(new Error(sentenceOf(request.responseText)));
  });
  for (const kind of ["error", "abort"]) request.addEventListener(kind, () => fail(new Error(`${file.name} did not arrive: the server did not take it, or does not answer.`)));
  request.open("POST", `/api/upload?name=${encodeURIComponent(file.name)}`);
  request.send(file);
});
const mebibytes = (bytes) => (bytes / 2 ** 20).toFixed(1);
const opened = (open) => { $("open").hidden = !open; $("opener").setAttribute("aria-expanded", String(open)); };

function showLogs() {
  const { logs } = page.state, key = JSON.stringify([page.log, logs.map(({ name, state, seen, sentence }) => [name, state, seen, sentence])]);
  if (page.shownLogs !== key) {
    page.shownLogs = key;
    redrawn($("logs"), logs.map((one, k) => [one, k + 1]).filter(([one]) => one.state !== "closed").map(([one, k]) => {
      const row = make("li", "", one.seen && k === page.log ? { "data-shown": true } : {});
      if (one.seen) row.append(make("button", one.name, { class: "plain", "data-key": `log-${k}`, "aria-pressed": String(k === page.log), onclick: () => showLog(k) }));
      else row.append(make("span", one.sentence ? `${one.name}: ${one.sentence}` : one.name, one.sentence ? { class: "bad" } : {}));
      if (goes(one)) row.append(make("progress", "", { "data-log": k, "aria-label": `reading ${one.name}` }), make("span", "", { class: "soft", "data-since": k }));
      row.append(make("button", "×", { class: "plain", "data-key": `close-${k}`, "aria-label": `close ${one.name}`, onclick: () => close(k) }));
      return row;
    }), $("opener"));
  }
  for (const bar of $("logs").querySelectorAll("progress")) {
    const one = logs[bar.dataset.log - 1];
    if (one.share === null || one.share === undefined) bar.removeAttribute("value"); else bar.value = one.share;
    bar.nextElementSibling.textContent = [one.told, one.bytes ? `${mebibytes(one.bytes)} MiB` : ""].filter(Boolean).join(", ");
  }
}

const close = tried(async (log) => {
  await ask(`/api/logs/${log}`, { method: "DELETE" });
  if (page.log === log) page.log = 0;
  delete page.told[log];
  await refresh();
});

// See
const lookUp = async (log) => { page.told[log] = await ask(`/api/logs/${log}`); };
const showLog = watched(async (log) => {
  const asked = (page.asked += 1);
  if (!page.told[log]?.inspection) await lookUp(log);
  // Meanwhile another was asked for.
  if (asked !== page.asked) return;
  const other = tracks.log !== log;
  page.log = log;
  choices.shown(log);
  const { channels, span_s, inspection } = told();
  $("work").hidden = false;
  if (other) {
    tracks.open(log, channels, span_s);
    spectra.clear();
    // What is chosen on it stands there at once, while its tracks are still drawn.
    choices.show();
    $("channels").replaceChildren(...channels.map((one, k) => make("option", "", { value: labelOf(channels, k), label: `${one.topic}${one.unit === "1" ? "" : `, ${one.unit}`}` })));
    $("names").replaceChildren(...[...new Set(channels.map((one) => one.name))].map((name) => make("option", "", { value: name })));
    $("spectral").replaceChildren(...channels.map((_, k) => make("option", labelOf(channels, k), { value: k })));
    const first = firstTracks(channels, inspection);
    $("spectral").value = String(first.at(-1) ?? 0);
    for (const channel of first) await tracks.add(channel);
    if (page.log !== log) return;
    tracks.look(...span_s);
    results.named();
  }
  // What ``inspect`` says may have come while the tracks were drawn.
  showInspection(told().inspection);
  showLogs();
  choices.show();
});

/** A name, with its topic where the log has the name twice. */
function labelOf(channels, k) {
  const { name, topic } = channels[k];
  return channels.findIndex((one) => one.name === name) === k ? name : `${name} of ${topic}`;
}

function showInspection(inspection) {
  if (!inspection) { $("facts").replaceChildren("What is in it is looked up …"); return; }
  const flown = inspection.flights.reduce((sum, one) => sum + one.stop_s - one.start_s, 0);
  $("facts").textContent = [inspection.name, inspection.firmware || inspection.format, inspection.vehicle, `${(inspection.stop_s - inspection.start_s).toFixed(1)} s, ${flown.toFixed(1)} s in the air`, counted(inspection.excitations.length, "excitation"), page.state.logs[page.log - 1]?.note].filter(Boolean).join(" · ");
  $("excitations").replaceChildren(...inspection.excitations.map((one) => make("li", `${one.axis} ${one.kind}, ${one.start_s.toFixed(1)} to ${one.stop_s.toFixed(1)} s `, {},
    make("button", "Use", { onclick: () => choices.addSegment({ axis: one.axis, start_s: one.start_s, stop_s: one.stop_s }) }), " ",
    make("button", "Look", { onclick: () => tracks.look(one.start_s - 1, one.stop_s + 1) }))));
  $("findings").replaceChildren(...inspection.findings.map((one) => {
    const at = timeOf(one), row = make("li", `${one.kind.replaceAll("_", " ")} (${one.where}): ${one.message} `, { class: { error: "bad", warning: "fair" }[one.severity] ?? "" });
    if (at !== null) row.append(make("button", "Look", { onclick: () => tracks.look(at - 2, at + 2) }));
    return row;
  }));
  const worse = inspection.findings.filter((one) => one.severity !== "info").length;
  $("found").firstElementChild.textContent = `${counted(inspection.excitations.length, "excitation")}, ${counted(inspection.findings.length, "finding")}${worse ? `, ${worse} of which limit the trust` : ""}`;
}

const spectralSpan = () => {
  const one = choices.segments.at(-1);
  return one ? [one.start_s, one.stop_s] : tracks.view;
};

const showSpan = () => { $("spectral-span").textContent = `from ${spectralSpan().map((at) => at.toFixed(1)).join(" to ")} s`; };

// The state of the server, asked for while something runs
const refresh = watched(async () => {
  const state = (page.state = await ask("/api/state"));
  angles.degrees = state.preferred?.angles === "deg";
  choices.begin(state);
  showLogs();
  const wanted = choices.now.log;
  if (!isSeen(page.log)) {
    page.log = 0;
    const last = state.logs.findLastIndex((one) => one.seen) + 1;
    if (isSeen(wanted) || last) { opened(false); await showLog(isSeen(wanted) ? wanted : last); } else { $("work").hidden = true; opened(true); }
  } else if (!told().inspection && state.logs[page.log - 1].state === "done") {
    await lookUp(page.log);
    showInspection(told()?.inspection);
    choices.show();
  } else choices.showOthers(state.logs);
  if (page.log && !state.logs.some(goes)) listModels();
  await results.show(state.steps);
  $("project-steps").hidden = !state.waiting.length;
  $("project-steps").firstElementChild.textContent = `${counted(state.waiting.length, "step")} of the project ${state.following ? "to come" : "not run yet"}`;
  $("waiting").hidden = state.following;
  if (state.folder) listFolder();
});

/** Work of the page that is asked for once, beside everything else; what failed is asked for again. */
const once = (work) => {
  let asked = false;
  return watched(async () => {
    if (asked) return;
    asked = true;
    try { asked = await work(); } catch (error) { asked = false; throw error; }
  });
};
const listModels = once(async () => {
  const { models } = await ask("/api/models");
  choices.catalog = models;
  choices.show();
  return models.length > 0;
});
const listFolder = once(async () => {
  const names = await ask("/api/folder");
  $("choices-of-folder").replaceChildren(...names.map((name) => make("li", "", {}, make("button", name, { class: "plain", onclick: tried(async () => { await post("/api/open", { name }); await refresh(); }) }))));
  $("folder").hidden = !names.length;
  return true;
});
const busy = () => [...page.state.logs, ...page.state.steps].some(goes) || page.state.following;
const watch = async () => {
  if (busy() && !document.hidden) await refresh();
  setTimeout(watch, POLL_MS);
};

const redraw = () => {
  document.querySelectorAll(".unit").forEach((one) => { one.textContent = unitText(); });
  results.redraw(page.state.steps);
  spectra.redraw();
  choices.show();
};

// What the page listens to
$("file").addEventListener("change", () => upload($("file").files));
for (const kind of ["dragover", "dragleave", "drop"]) {
  document.addEventListener(kind, (event) => { event.preventDefault(); document.body.classList.toggle("over", kind === "dragover"); });
}
document.addEventListener("drop", (event) => upload(event.dataTransfer.files));
$("demo").addEventListener("click", tried(async () => {
  await post("/api/demo", {});
  await refresh();
}));
$("opener").addEventListener("click", () => opened($("open").hidden));
$("keys").addEventListener("click", () => { $("keyboard").hidden = !$("keyboard").hidden; $("keys").setAttribute("aria-expanded", String(!$("keyboard").hidden)); });
$("channel").addEventListener("change", tried(async () => {
  const wanted = $("channel").value.trim(), { channels } = told(), channel = channels.findIndex((_, k) => labelOf(channels, k) === wanted);
  if (channel < 0) throw new Error(`${wanted} is no channel of this log; the field offers those that are.`);
  $("channel").value = "";
  await tracks.add(channel);
}));
$("whole").addEventListener("click", () => tracks.whole());
for (const kind of ["spectrum", "spectrogram"]) {
  $(kind).addEventListener("click", () => {
    const channel = Number($("spectral").value), { name, unit } = told().channels[channel];
    spectra.add(kind, page.log, { channel, name, unit }, spectralSpan());
  });
}
const run = tried((verb) => start(choices.step(verb)));
for (const verb of ["review", "response", "identify"]) $(`run-${verb}`).addEventListener("click", () => run(verb));
$("waiting").addEventListener("click", tried(async () => { await post("/api/waiting", {}); await refresh(); }));
$("units").addEventListener("change", redraw);
$("scale").addEventListener("change", redraw);
const theme = (name) => { if (name) document.documentElement.dataset.theme = name; };
$("theme").addEventListener("click", () => {
  theme(isDark() ? "light" : "dark");
  keep("localStorage", "theme", document.documentElement.dataset.theme);
  redraw();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
document.addEventListener("keydown", (event) => {
  // A key that is held says the same again: one command is meant.
  if (event.repeat || ["INPUT", "SELECT"].includes(document.activeElement.tagName)) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") {
    event.preventDefault();
    if (event.shiftKey) choices.redo(); else choices.undo();
  } else if (!event.ctrlKey && !event.metaKey && !event.altKey && page.log) {
    const verb = { r: "review", f: "response", i: "identify" }[event.key];
    if (verb) run(verb);
    else if (event.key === "s") $("add-segment").click();
  }
});
theme(kept("localStorage", "theme"));
await refresh();
const preferred = page.state.preferred ?? {};
theme(kept("localStorage", "theme") ?? preferred.theme);
if (preferred.magnitude) $("scale").value = preferred.magnitude === "linear" ? "linear" : "db";
if (preferred.frequency) $("units").value = preferred.frequency === "Hz" ? "hz" : "rad";
if (Object.keys(preferred).length) redraw();
watch();
