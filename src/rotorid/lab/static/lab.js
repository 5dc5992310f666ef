// The page: choices become a step, a step becomes a command line, and the server runs it.
import { Choices } from "./choices.js";
import { $, angles, ask, counted, headingOf, keep, kept, learn, make, post, redrawn, sentenceOf, tried, unitText, watched } from "./page.js";
import { isDark } from "./plots.js";
import { Results } from "./results.js";
import { Spectra } from "./spectra.js";
import { Tracks, firstTracks } from "./tracks.js";

const POLL_MS = 350;
const page = { state: { logs: [], steps: [], waiting: [] }, log: 0, contents: {}, asked: 0 };
const shownLog = () => page.contents[page.log];
const goes = (work) => ["waiting", "running"].includes(work.state);
const isReadable = (log) => Boolean(page.state.logs[log - 1]?.readable);

const choices = new Choices({
  changed: () => { choices.showOthers(page.state.logs); tracks.redraw(); showSpan(); },
  log: () => page.log, shownLog, isOpen: (k) => page.state.logs[k - 1]?.state === "done", isReadable, view: () => tracks.view.map((at) => Number(at.toFixed(3))),
  names: () => page.state.logs.map((log) => log.name), show: (log) => { if (log !== page.log) showLog(log); },
});
const spectra = new Spectra($("spectra"));
const tracks = new Tracks($("tracks"), {
  bands: () => [
    ...(shownLog()?.inspection?.flights ?? []).map((flight) => ({ start: flight.start_s, stop: flight.stop_s, color: "--flight" })),
    ...(shownLog()?.inspection?.excitations ?? []).map((excitation) => ({ start: excitation.start_s, stop: excitation.stop_s, color: "--excitation", label: excitation.axis })),
  ],
  marks: () => (shownLog()?.inspection?.findings ?? []).filter((finding) => finding.severity !== "info").map(timeOf).filter((at) => at !== null),
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

/** The time of a finding, if it has one. */
function timeOf(finding) {
  const { start_s, first_s, longest_at_s } = finding.numbers;
  return start_s ?? first_s ?? longest_at_s ?? null;
}

// Open
const upload = tried(async (files) => {
  const refused = [];
  for (const file of files) {
    // A refused log does not stop the others.
    try { await sent(file); } catch (error) { refused.push(error.message); }
    await refresh();
  }
  $("taking").hidden = true;
  if (refused.length) throw new Error(refused.join(" "));
});

/** Upload a file and show progress, which only the older kind of request reports. */
const sent = (file) => new Promise((done, fail) => {
  const request = new XMLHttpRequest(), [text, bar] = $("taking").children;
  $("taking").hidden = false;
  text.textContent = `uploading ${file.name}`;
  bar.value = 0;
  request.upload.addEventListener("progress", ({ loaded, total }) => {
    bar.value = loaded / Math.max(total, 1);
    text.textContent = `uploading ${file.name}: ${mebibytes(loaded)} of ${mebibytes(total)} MiB`;
  });
  request.addEventListener("load", () => {
    if (request.status < 400) done();
    else fail(new Error(sentenceOf(request.responseText)));
  });
  for (const kind of ["error", "abort"]) request.addEventListener(kind, () => fail(new Error(`${file.name} was not uploaded: the server refused it or does not answer.`)));
  request.open("POST", `/api/upload?name=${encodeURIComponent(file.name)}`);
  request.send(file);
});
const mebibytes = (bytes) => (bytes / 2 ** 20).toFixed(1);
const opened = (open) => { $("open").hidden = !open; $("opener").setAttribute("aria-expanded", String(open)); };

function showLogs() {
  const { logs } = page.state, key = JSON.stringify([page.log, logs.map(({ name, state, readable, sentence }) => [name, state, readable, sentence])]);
  if (page.shownLogs !== key) {
    page.shownLogs = key;
    redrawn($("logs"), logs.map((log, k) => [log, k + 1]).filter(([log]) => log.state !== "closed").map(([log, k]) => {
      const row = make("li", "", log.readable && k === page.log ? { "data-shown": true } : {});
      if (log.readable) row.append(make("button", log.name, { class: "plain", "data-key": `log-${k}`, "aria-pressed": String(k === page.log), onclick: () => showLog(k) }));
      else row.append(make("span", log.sentence ? `${log.name}: ${log.sentence}` : log.name, log.sentence ? { class: "bad" } : {}));
      if (goes(log)) row.append(make("progress", "", { "data-log": k, "aria-label": `reading ${log.name}` }), make("span", "", { class: "soft", "data-since": k }));
      row.append(make("button", "×", { class: "plain", "data-key": `close-${k}`, "aria-label": `close ${log.name}`, onclick: () => close(k) }));
      return row;
    }), $("opener"));
  }
  for (const bar of $("logs").querySelectorAll("progress")) {
    const log = logs[bar.dataset.log - 1];
    if (log.share === null || log.share === undefined) bar.removeAttribute("value"); else bar.value = log.share;
    bar.nextElementSibling.textContent = [log.doing, log.bytes ? `${mebibytes(log.bytes)} MiB` : ""].filter(Boolean).join(", ");
  }
}

const close = tried(async (log) => {
  await ask(`/api/logs/${log}`, { method: "DELETE" });
  if (page.log === log) page.log = 0;
  delete page.contents[log];
  await refresh();
});

// See
const lookUp = async (log) => { page.contents[log] = await ask(`/api/logs/${log}`); };
const showLog = watched(async (log) => {
  const asked = (page.asked += 1);
  if (!page.contents[log]?.inspection) await lookUp(log);
  // Meanwhile another was asked for.
  if (asked !== page.asked) return;
  const other = tracks.log !== log;
  page.log = log;
  choices.shown(log);
  const { channels, span_s, inspection } = shownLog();
  $("work").hidden = false;
  if (other) {
    tracks.open(log, channels, span_s);
    spectra.clear();
    // Show its choices at once, while its tracks are still drawn.
    choices.show();
    $("channels").replaceChildren(...channels.map((channel, k) => make("option", "", { value: labelOf(channels, k), label: `${channel.topic}${channel.unit === "1" ? "" : `, ${channel.unit}`}` })));
    $("names").replaceChildren(...[...new Set(channels.map((channel) => channel.name))].map((name) => make("option", "", { value: name })));
    $("spectral").replaceChildren(...channels.map((_, k) => make("option", labelOf(channels, k), { value: k })));
    const first = firstTracks(channels, inspection);
    $("spectral").value = String(first.at(-1) ?? 0);
    for (const channel of first) await tracks.add(channel);
    if (page.log !== log) return;
    tracks.look(...span_s);
    results.named();
  }
  // The inspection may have arrived while the tracks were drawn.
  showInspection(shownLog().inspection);
  showLogs();
  choices.show();
});

/** A name, with its topic where the log has the name twice. */
function labelOf(channels, k) {
  const { name, topic } = channels[k];
  return channels.findIndex((channel) => channel.name === name) === k ? name : `${name} of ${topic}`;
}

function showInspection(inspection) {
  if (!inspection) { $("facts").replaceChildren("Looking for flights and excitations …"); return; }
  const flown = inspection.flights.reduce((sum, flight) => sum + flight.stop_s - flight.start_s, 0);
  $("facts").textContent = [inspection.name, inspection.firmware || inspection.format, inspection.vehicle, `${(inspection.stop_s - inspection.start_s).toFixed(1)} s, ${flown.toFixed(1)} s in the air`, counted(inspection.excitations.length, "excitation"), page.state.logs[page.log - 1]?.note].filter(Boolean).join(" · ");
  $("excitations").replaceChildren(...inspection.excitations.map((excitation) => make("li", `${excitation.axis} ${excitation.kind}, ${excitation.start_s.toFixed(1)} to ${excitation.stop_s.toFixed(1)} s `, {},
    make("button", "Use", { onclick: () => choices.addSegment({ axis: excitation.axis, start_s: excitation.start_s, stop_s: excitation.stop_s }) }), " ",
    make("button", "Look", { onclick: () => tracks.look(excitation.start_s - 1, excitation.stop_s + 1) }))));
  $("findings").replaceChildren(...inspection.findings.map((finding) => {
    const at = timeOf(finding), row = make("li", `${headingOf(finding.kind)} (${finding.where}): ${finding.message} `, { class: { error: "bad", warning: "fair" }[finding.severity] ?? "" });
    if (at !== null) row.append(make("button", "Look", { onclick: () => tracks.look(at - 2, at + 2) }));
    return row;
  }));
  const worse = inspection.findings.filter((finding) => finding.severity !== "info").length;
  $("found").firstElementChild.textContent = `${counted(inspection.excitations.length, "excitation")}, ${counted(inspection.findings.length, "finding")}${worse ? `, ${worse} of them ${worse === 1 ? "a warning" : "warnings"}` : ""}`;
}

const spectralSpan = () => {
  const segment = choices.segments.at(-1);
  return segment ? [segment.start_s, segment.stop_s] : tracks.view;
};

const showSpan = () => { $("spectral-span").textContent = `from ${spectralSpan().map((at) => at.toFixed(1)).join(" to ")} s`; };

// The state of the server, asked for while something runs
const refresh = watched(async () => {
  const state = (page.state = await ask("/api/state"));
  angles.degrees = state.preferred?.angles === "deg";
  choices.begin(state);
  showLogs();
  const wanted = choices.now.log;
  if (!isReadable(page.log)) {
    page.log = 0;
    const last = state.logs.findLastIndex((log) => log.readable) + 1;
    if (isReadable(wanted) || last) { opened(false); await showLog(isReadable(wanted) ? wanted : last); } else { $("work").hidden = true; opened(true); }
  } else if (!shownLog().inspection && state.logs[page.log - 1].state === "done") {
    await lookUp(page.log);
    showInspection(shownLog()?.inspection);
    choices.show();
  } else choices.showOthers(state.logs);
  if (page.log && !state.logs.some(goes)) listModels();
  await results.show(state.steps);
  $("project-steps").hidden = !state.waiting.length;
  $("project-steps").firstElementChild.textContent = `${counted(state.waiting.length, "step")} of the project ${state.following ? "to run" : "not run yet"}`;
  $("waiting").hidden = state.following;
  if (state.folder) listFolder();
});

/** Work that is done once, in the background; after a failure it is done again. */
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
  document.querySelectorAll(".unit").forEach((place) => { place.textContent = unitText(); });
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
  const wanted = $("channel").value.trim(), { channels } = shownLog(), channel = channels.findIndex((_, k) => labelOf(channels, k) === wanted);
  if (channel < 0) throw new Error(`unknown channel '${wanted}'; choose one from the list.`);
  $("channel").value = "";
  await tracks.add(channel);
}));
$("whole").addEventListener("click", () => tracks.whole());
for (const kind of ["spectrum", "spectrogram"]) {
  $(kind).addEventListener("click", () => {
    const channel = Number($("spectral").value), { name, unit } = shownLog().channels[channel];
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
  // A key that is held down repeats: only its first event counts.
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
learn(await ask("/api/words").catch(() => ({})));
await refresh();
const preferred = page.state.preferred ?? {};
theme(kept("localStorage", "theme") ?? preferred.theme);
if (preferred.magnitude) $("scale").value = preferred.magnitude === "linear" ? "linear" : "db";
if (preferred.frequency) $("units").value = preferred.frequency === "Hz" ? "hz" : "rad";
if (Object.keys(preferred).length) redraw();
watch();
