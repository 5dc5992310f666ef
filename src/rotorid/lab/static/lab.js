// The page: what is chosen here becomes a step, a step becomes a command line, and the server runs that.
import { Choices } from "./choices.js";
import { $, ask, counted, make, number, post, say, shownOmega, tried, unitText } from "./page.js";
import { gram, lines } from "./plots.js";
import { Results } from "./results.js";
import { Tracks, firstTracks } from "./tracks.js";

const POLL_MS = 350;
const page = { state: { logs: [], steps: [], waiting: [] }, log: 0, told: {}, demo: false };
const told = () => page.told[page.log];

const choices = new Choices({ changed: () => tracks.redraw(), log: () => page.log, told, isOpen: (k) => page.state.logs[k - 1]?.state === "done" });
const tracks = new Tracks($("tracks"), {
  bands: () => [
    ...(told()?.inspection?.flights ?? []).map((one) => ({ start: one.start_s, stop: one.stop_s, color: "--flight" })),
    ...(told()?.inspection?.excitations ?? []).map((one) => ({ start: one.start_s, stop: one.stop_s, color: "--excitation", label: one.axis })),
  ],
  marks: () => (told()?.inspection?.findings ?? []).filter((one) => one.severity !== "info").map(timeOf).filter((at) => at !== null),
  segments: () => choices.now.segments,
  brushed: (start, stop) => choices.brushed(start, stop),
  edged: (k, side, at, last) => choices.edged(k, side, at, last),
  viewed: () => { $("spectral-span").textContent = `from ${spectralSpan().map((at) => at.toFixed(1)).join(" to ")} s`; },
});
const start = tried(async (step) => {
  await post("/api/steps", step);
  say("");
  await refresh();
  $(`step-${page.state.steps.length}`)?.scrollIntoView({ behavior: "auto", block: "nearest" });
});
const results = new Results({ log: () => page.log, start, band: (band) => { choices.set({ band }); $("more").open = true; }, refresh: () => refresh() });

/** When a finding happened, as far as it has a time. */
function timeOf(finding) {
  const { start_s, first_s, longest_at_s } = finding.numbers;
  return start_s ?? first_s ?? longest_at_s ?? null;
}

// Open
const upload = tried(async (files) => {
  for (const file of files) {
    say(`taking in ${file.name}`);
    await ask(`/api/upload?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    await refresh();
  }
  say("");
});
const opened = (open) => { $("open").hidden = !open; $("opener").setAttribute("aria-expanded", String(open)); };

function showLogs() {
  const { logs } = page.state, key = JSON.stringify([page.log, logs.map(({ name, state, seen, sentence }) => [name, state, seen, sentence])]);
  if (page.shownLogs === key) return;
  page.shownLogs = key;
  $("logs").replaceChildren(...logs.map((one, k) => [one, k + 1]).filter(([one]) => one.state !== "closed").map(([one, k]) => {
    const row = make("li", "", one.seen && k === page.log ? { "data-shown": true } : {});
    if (one.seen) row.append(make("button", one.name, { class: "plain", "aria-pressed": String(k === page.log), onclick: () => showLog(k) }));
    else row.append(make("span", one.sentence ? `${one.name}: ${one.sentence}` : one.name, one.sentence ? { class: "bad" } : {}));
    if (one.state === "running" || one.state === "waiting") row.append(make("progress", "", { "aria-label": `reading ${one.name}` }));
    row.append(make("button", "×", { class: "plain", "aria-label": `close ${one.name}`, onclick: tried(async () => { await ask(`/api/logs/${k}`, { method: "DELETE" }); if (page.log === k) page.log = 0; await refresh(); }) }));
    return row;
  }));
}

// See
const showLog = tried(async (log) => {
  if (!page.told[log]?.inspection) page.told[log] = await ask(`/api/logs/${log}`);
  const other = page.log !== log || tracks.log !== log;
  // Segments are on the clock of the log that they were brushed on.
  if (tracks.log && tracks.log !== log) choices.set({ segments: [] });
  page.log = log;
  const { channels, span_s, inspection } = told();
  $("work").hidden = false;
  if (other) {
    tracks.open(log, channels, span_s);
    $("spectra").replaceChildren();
    $("channels").replaceChildren(...channels.map((one, k) => make("option", "", { value: labelOf(channels, k), label: `${one.topic}${one.unit === "1" ? "" : `, ${one.unit}`}` })));
    $("names").replaceChildren(...[...new Set(channels.map((one) => one.name))].map((name) => make("option", "", { value: name })));
    $("spectral").replaceChildren(...channels.map((_, k) => make("option", labelOf(channels, k), { value: k })));
    const first = firstTracks(channels, inspection);
    $("spectral").value = String(first.at(-1) ?? 0);
    for (const channel of first) await tracks.add(channel);
    tracks.look(...span_s);
  }
  showInspection(inspection);
  showLogs();
  choices.showOthers(page.state.logs);
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
  $("facts").textContent = [inspection.name, inspection.firmware || inspection.format, inspection.vehicle, `${(inspection.stop_s - inspection.start_s).toFixed(1)} s, ${flown.toFixed(1)} s in the air`, counted(inspection.excitations.length, "excitation")].filter(Boolean).join(" · ");
  $("excitations").replaceChildren(...inspection.excitations.map((one) => make("li", `${one.axis} ${one.kind}, ${one.start_s.toFixed(1)} to ${one.stop_s.toFixed(1)} s `, {},
    make("button", "Use", { onclick: () => choices.set({ segments: [...choices.now.segments, { axis: one.axis, start_s: one.start_s, stop_s: one.stop_s }] }) }), " ",
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
  const one = choices.now.segments.at(-1);
  return one ? [one.start_s, one.stop_s] : tracks.view;
};
const spectra = (kind) => tried(async () => {
  const [begin, end] = spectralSpan(), channel = Number($("spectral").value), row = told().channels[channel], box = make("div");
  const found = await ask(`/api/logs/${page.log}/${kind}?channel=${channel}&start=${begin}&stop=${end}`);
  if (!(found.density ?? found.density_db).length) throw new Error("The interval holds too few samples for that.");
  $("spectra").prepend(box);
  const title = `${kind} of ${row.name}, ${begin.toFixed(1)} to ${end.toFixed(1)} s`;
  box.append(make("button", "×", { class: "plain", "aria-label": `remove the ${kind}`, onclick: () => box.remove() }));
  if (kind === "spectrum") {
    lines(box, { title, x: found.frequency_rad_s.map(shownOmega), rows: [{ label: "density", y: found.density.map((v) => (v > 0 ? v : null)) }], xLabel: unitText(), yLabel: `(${row.unit})²/Hz`, logY: true });
  } else {
    const w = found.frequency_rad_s;
    box.append(make("b", title));
    gram(box, found, title, [w[0], w.at(-1)].map((omega) => `${number(shownOmega(omega), 3)} ${unitText()}`));
  }
});

// The state of the server, asked for while something runs
const refresh = tried(async () => {
  const state = (page.state = await ask("/api/state"));
  if (page.demo && state.logs.length > page.demo.logs) { page.demo = false; say(""); }
  showLogs();
  const seen = state.logs.map((one, k) => [one, k + 1]).filter(([one]) => one.seen);
  if (!seen.some(([, k]) => k === page.log)) {
    page.log = 0;
    if (seen.length) { opened(false); await showLog(seen.at(-1)[1]); } else { $("work").hidden = true; opened(true); }
  } else if (!told().inspection && state.logs[page.log - 1].state === "done") await showLog(page.log);
  else choices.showOthers(state.logs);
  if (seen.length && !choices.catalog.length && state.logs.every((one) => !["waiting", "running"].includes(one.state))) {
    choices.catalog = (await ask("/api/models")).models;
    choices.show();
  }
  await results.show(state.steps);
  $("waiting").hidden = !state.waiting.length || state.steps.length > 0;
  if (state.folder && !$("choices-of-folder").childElementCount) {
    const found = await ask("/api/folder");
    $("choices-of-folder").replaceChildren(...found.map((name) => make("li", "", {}, make("button", name, { class: "plain", onclick: tried(async () => { await post("/api/open", { name }); await refresh(); }) }))));
    $("folder").hidden = !found.length;
  }
});
const busy = () => page.demo || [...page.state.logs, ...page.state.steps].some((one) => ["waiting", "running"].includes(one.state));
const watch = async () => {
  if (busy() && !document.hidden) await refresh();
  setTimeout(watch, POLL_MS);
};

const redraw = () => {
  document.querySelectorAll(".unit").forEach((one) => { one.textContent = unitText(); });
  results.redraw(page.state.steps);
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
  say("The demonstration flies: half a minute.");
  page.demo = { logs: page.state.logs.length };
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
$("spectrum").addEventListener("click", spectra("spectrum"));
$("spectrogram").addEventListener("click", spectra("spectrogram"));
const run = (verb) => start(choices.step(verb));
for (const verb of ["review", "response", "identify"]) $(`run-${verb}`).addEventListener("click", () => run(verb));
$("waiting").addEventListener("click", tried(async () => {
  for (const step of page.state.waiting) {
    await start(step);
    while (busy()) { await new Promise((done) => { setTimeout(done, POLL_MS); }); await refresh(); }
  }
}));
$("copy").addEventListener("click", tried(async () => { await navigator.clipboard.writeText($("command").textContent); say("The command is copied."); }));
$("units").addEventListener("change", redraw);
$("scale").addEventListener("change", redraw);
$("theme").addEventListener("click", async () => {
  const root = document.documentElement, dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  const { view } = tracks, shown = tracks.shown.map(({ channel }) => channel);
  if (page.log) {
    tracks.open(page.log, told().channels, told().span_s);
    tracks.view = view;
    for (const channel of shown) await tracks.add(channel);
  }
  redraw();
});
document.addEventListener("keydown", (event) => {
  if (["INPUT", "SELECT"].includes(document.activeElement.tagName)) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") {
    event.preventDefault();
    if (event.shiftKey) choices.redo(); else choices.undo();
  } else if (!event.ctrlKey && !event.metaKey && !event.altKey && page.log) {
    const verb = { r: "review", f: "response", i: "identify" }[event.key];
    if (verb) run(verb);
  }
});
await refresh();
const preferred = page.state.preferred ?? {};
if (preferred.theme) document.documentElement.dataset.theme = preferred.theme;
if (preferred.magnitude) $("scale").value = preferred.magnitude === "linear" ? "linear" : "db";
if (preferred.frequency) $("units").value = preferred.frequency === "Hz" ? "hz" : "rad";
if (Object.keys(preferred).length) redraw();
watch();
