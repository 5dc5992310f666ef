// The page: what is chosen here becomes a step, a step becomes a command line, and the server runs that.
import { gram, lines, phaseOf, track } from "./plots.js";

const $ = (id) => document.getElementById(id);
const make = (tag, text = "", attributes = {}) => {
  const one = document.createElement(tag);
  one.textContent = text;
  for (const [name, value] of Object.entries(attributes)) name.startsWith("on") ? one.addEventListener(name.slice(2), value) : one.setAttribute(name, value);
  return one;
};
const say = (text, bad = false) => { $("message").textContent = text; $("message").className = bad ? "bad" : ""; };
const ask = async (path, options = {}) => {
  const answer = await fetch(path, { cache: "no-store", ...options });
  if (!answer.ok) {
    const text = await answer.text();
    let sentence = text;
    try { sentence = JSON.parse(text).sentence ?? text; } catch { /* it was plain text */ }
    throw new Error(sentence);
  }
  return answer.json();
};
const post = (path, body) => ask(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
const tried = (work) => async (...given) => { try { await work(...given); } catch (error) { say(error.message, true); } };
const number = (value) => value === null || value === undefined ? "" : Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-3) ? value.toExponential(4) : String(Number(value.toPrecision(6)));

const page = { state: { logs: [], steps: [], waiting: [] }, log: 0, told: {}, tracks: [], view: null, undone: [], shown: {} };
let choice = { segments: [], inputs: "", outputs: "", instrument: "", band: null, model: "" };
const hz = () => $("units").value === "hz";
const shownOmega = (omega) => hz() ? omega / (2 * Math.PI) : omega;
const omegaOf = (value) => hz() ? value * 2 * Math.PI : value;
const unitText = () => hz() ? "Hz" : "rad/s";

// Choices, and the way back
const choose = (change) => { page.undone.push(JSON.stringify(choice)); choice = { ...choice, ...change }; showChoice(); };
const undo = () => { if (page.undone.length) { choice = JSON.parse(page.undone.pop()); showChoice(); } };
const names = (text) => text.split(",").map((one) => one.trim()).filter(Boolean);
const stepOf = (verb, more = {}) => {
  const step = { verb, logs: [page.log], ...more };
  if (verb === "identify" || verb === "response") {
    step.segments = choice.segments.map(({ axis, start_s, stop_s }) => ({ axis, start_s, stop_s }));
    if (choice.band) step.band_rad_s = choice.band;
    if (names(choice.instrument).length) step.instrument = names(choice.instrument);
  }
  if (verb === "response") { step.inputs = names(choice.inputs); step.outputs = names(choice.outputs); }
  if (verb === "identify") step.models = [choice.model || $("model").value];
  return step;
};
const showCommand = tried(async () => {
  if (!page.log) return;
  const told = await post("/api/preview", stepOf("identify"));
  $("command").textContent = told.command.map((word) => /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`).join(" ");
});
function showChoice() {
  $("segments").replaceChildren(...choice.segments.map((one, k) => {
    const row = make("li");
    const edge = (name, label) => {
      const field = make("input", "", { type: "number", step: "0.1", "aria-label": `${label} of segment ${k + 1} in seconds` });
      field.value = one[name];
      field.addEventListener("change", () => choose({ segments: choice.segments.map((other, n) => n === k ? { ...other, [name]: Number(field.value) } : other) }));
      return field;
    };
    row.append(`${one.axis} `, edge("start_s", "start"), " to ", edge("stop_s", "stop"), " s ",
      make("button", "Remove", { onclick: () => choose({ segments: choice.segments.filter((_, n) => n !== k) }) }));
    return row;
  }));
  for (const name of ["inputs", "outputs", "instrument"]) $(name).value = choice[name];
  $("low").value = choice.band ? number(shownOmega(choice.band[0])) : "";
  $("high").value = choice.band ? number(shownOmega(choice.band[1])) : "";
  if (choice.model) $("model").value = choice.model;
  showNeeds();
  page.tracks.forEach(({ plot }) => plot.redraw());
  showCommand();
}
function showNeeds() {
  const support = page.told[page.log]?.inspection.supports[$("model").value];
  $("needs").textContent = support ? `${support.possible ? "The log gives what it needs" : "Not without a choice"}: ${support.because}${support.remedy ? `; ${support.remedy}` : ""}` : "";
}

// Open
const upload = tried(async (files) => {
  for (const file of files) {
    say(`reading ${file.name}`);
    await ask(`/api/upload?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  }
  await refresh();
});

// See
const bands = () => {
  const inspection = page.told[page.log]?.inspection;
  const found = (inspection?.flights ?? []).map((one) => ({ start: one.start_s, stop: one.stop_s, color: "#4c9f7022" }));
  for (const one of inspection?.excitations ?? []) found.push({ start: one.start_s, stop: one.stop_s, color: "#d98a0044" });
  for (const one of choice.segments) found.push({ start: one.start_s, stop: one.stop_s, color: "#0b5cad55" });
  return found;
};
const round = (value) => Math.round(value * 1000) / 1000;
const brush = (start, stop) => {
  const near = (stop - start) * 0.05 + 0.05;
  const k = choice.segments.findIndex((one) => Math.abs(one.start_s - start) < near || Math.abs(one.stop_s - stop) < near);
  const one = { axis: $("axis").value, start_s: round(start), stop_s: round(stop) };
  // A brush that begins or ends where a segment does moves the edges of that segment.
  choose({ segments: k >= 0 ? choice.segments.map((other, n) => n === k ? { ...other, start_s: one.start_s, stop_s: one.stop_s } : other) : [...choice.segments, one] });
};
const moved = tried(async (start, stop) => {
  page.view = [start, stop];
  for (const one of page.tracks) {
    const told = await ask(`/api/logs/${page.log}/track?channel=${one.channel}&start=${start}&stop=${stop}&points=${one.plot.width}`);
    one.plot.setData([told.x, told.y], false);
    one.plot.batch(() => {
      one.plot.setScale("x", { min: start, max: stop });
      const kept = told.y.filter((value) => value !== null);
      let low = Infinity, high = -Infinity;
      for (const value of kept) { low = Math.min(low, value); high = Math.max(high, value); }
      if (kept.length) one.plot.setScale("y", low === high ? { min: low - 1, max: high + 1 } : { min: low - 0.05 * (high - low), max: high + 0.05 * (high - low) });
    });
  }
});
const addTrack = tried(async (channel) => {
  const told = page.told[page.log], row = told.channels[channel], box = make("div", "", { class: "track" });
  $("tracks").append(box);
  const [start, stop] = page.view ?? [told.inspection.start_s, told.inspection.stop_s];
  const data = await ask(`/api/logs/${page.log}/track?channel=${channel}&start=${start}&stop=${stop}&points=1200`);
  const plot = track(box, { title: `${row.name} (${row.topic})`, unit: row.unit, data: [data.x, data.y], bands, brush, zoom: () => $("mode").value === "zoom", moved });
  page.tracks.push({ channel, plot });
});
const showLog = tried(async (log) => {
  page.told[log] ??= await ask(`/api/logs/${log}`);
  page.log = log; page.view = null;
  const { channels, inspection } = page.told[log];
  $("log").value = String(log);
  $("channel").replaceChildren(...channels.map((one, k) => make("option", `${one.name} [${one.unit}] ${one.topic}`, { value: k })));
  $("names").replaceChildren(...[...new Set(channels.map((one) => one.name))].map((name) => make("option", "", { value: name })));
  $("model").replaceChildren(...Object.entries(inspection.supports).map(([name, one]) => make("option", `${name}${one.possible ? "" : " (see below)"}`, { value: name })));
  $("excitations").replaceChildren(...inspection.excitations.map((one) => {
    const row = make("li", `${one.axis} ${one.kind}, ${one.start_s.toFixed(1)} to ${one.stop_s.toFixed(1)} s `);
    row.append(make("button", "Use", { onclick: () => choose({ segments: [...choice.segments, { axis: one.axis, start_s: one.start_s, stop_s: one.stop_s }] }) }));
    return row;
  }));
  $("findings").replaceChildren(...inspection.findings.map((one) => make("li", `${one.severity} ${one.kind.replaceAll("_", " ")} (${one.where}): ${one.message}`)));
  $("see").hidden = $("choices").hidden = false;
  page.tracks.forEach(({ plot }) => plot.destroy()); page.tracks = []; $("tracks").replaceChildren();
  for (const name of ["roll_command", "p"]) { const k = channels.findIndex((one) => one.name === name); if (k >= 0) await addTrack(k); }
  if (!page.tracks.length && channels.length) await addTrack(0);
  showChoice();
});
const spectra = (kind) => tried(async () => {
  const one = choice.segments.at(-1), inspection = page.told[page.log].inspection;
  const [start, stop] = one ? [one.start_s, one.stop_s] : [inspection.start_s, inspection.stop_s], channel = Number($("channel").value);
  const row = page.told[page.log].channels[channel], box = make("div");
  const told = await ask(`/api/logs/${page.log}/${kind}?channel=${channel}&start=${start}&stop=${stop}`);
  if (!(told.density ?? told.density_db).length) throw new Error("The segment holds too few samples for that.");
  $("spectra").prepend(box);
  const title = `${kind} of ${row.name}, ${start.toFixed(1)} to ${stop.toFixed(1)} s`;
  if (kind === "spectrum") lines(box, { title, x: told.frequency_rad_s.map(shownOmega), rows: [{ label: "density", y: told.density.map((v) => v > 0 ? v : null) }], xLabel: unitText(), yLabel: `(${row.unit})²/Hz`, logY: true });
  else { const w = told.frequency_rad_s; box.append(make("h3", `${title}; ${number(shownOmega(w[0]))} to ${number(shownOmega(w.at(-1)))} ${unitText()} upward`)); gram(box, told, title); }
});

// Results
const tableOf = (heads, rows) => {
  const box = make("div", "", { class: "scroll" }), table = make("table"), head = make("tr");
  heads.forEach((one) => head.append(make("th", one, { scope: "col" })));
  table.append(head);
  rows.forEach((row) => { const line = make("tr"); row.forEach((one, k) => line.append(make("td", one, k ? { class: "n" } : {}))); table.append(line); });
  box.append(table);
  return box;
};
const interval = (one) => one ? `${number(one.value)} (${number(one.lower)} to ${number(one.upper)})` : "";
const findingsOf = (found) => { const list = make("ul"); (found ?? []).slice(0, 20).forEach((one) => list.append(make("li", `${one.severity} ${one.kind.replaceAll("_", " ")}: ${one.message}`, one.severity === "error" ? { class: "bad" } : {}))); return list; };
function showCurves(card, curves) {
  if (!curves.omega_rad_s) return;
  const x = curves.omega_rad_s.map(shownOmega), db = $("scale").value === "db";
  const size = (re, im) => re.map((value, k) => { const m = value === null || im[k] === null ? null : Math.hypot(value, im[k]); return m && db ? 20 * Math.log10(m) : m; });
  const band = (a, b) => choose({ band: [omegaOf(a), omegaOf(b)].map((value) => Number(value.toPrecision(4))) });
  const both = (i, j, part) => {
    const rows = [{ label: "measured", y: part(curves["values.re"][i][j], curves["values.im"][i][j]) }];
    if (curves["model.re"]) rows.push({ label: "model", y: part(curves["model.re"][i][j], curves["model.im"][i][j]) });
    return rows;
  };
  curves.outputs.forEach((output, i) => curves.inputs.forEach((input, j) => {
    const name = `${output} / ${input}`;
    const magnitude = both(i, j, size), error = curves.random_error?.[i][j];
    if (error) for (const sign of [-1, 1]) magnitude.push({ label: sign < 0 ? "− 1 std" : "+ 1 std", dash: [2, 3], y: magnitude[0].y.map((v, k) => v === null || error[k] === null || 1 + sign * error[k] <= 0 ? null : db ? v + 20 * Math.log10(1 + sign * error[k]) : v * (1 + sign * error[k])) });
    lines(card, { title: `${name}: magnitude; a drag chooses the band`, x, rows: magnitude, xLabel: unitText(), yLabel: db ? "dB" : "linear", brush: band });
    lines(card, { title: `${name}: phase`, x, rows: both(i, j, phaseOf), xLabel: unitText(), yLabel: "deg", brush: band });
    lines(card, { title: `${name}: coherence`, x, rows: [{ label: "coherence", y: curves.coherence[i][j] }], xLabel: unitText(), yLabel: "", brush: band });
    if (curves["model.re"]) lines(card, { title: `${name}: residual`, x, rows: [{ label: "measured − model, over measured", y: curves["values.re"][i][j].map((re, k) => { const im = curves["values.im"][i][j][k], a = curves["model.re"][i][j][k], b = curves["model.im"][i][j][k]; return [re, im, a, b].includes(null) ? null : Math.hypot(re - a, im - b) / Math.hypot(re, im); }) }], xLabel: unitText(), yLabel: "share" });
  }));
}
const shows = {
  identify(card, told, k) {
    card.append(tableOf(["parameter", "value", "from", "to (95 %)", "unit", "status"], Object.entries(told.parameters ?? {}).map(([name, one]) => [name, number(one.value), number(one.lower), number(one.upper), one.unit, one.status])));
    if (told.cost) card.append(make("p", `Cost ${number(told.cost.average)}`));
    if (told.poles?.length) card.append(make("p", `Poles: ${told.poles.map((one) => `${number(one.real)}${one.imag ? ` ± ${number(Math.abs(one.imag))}j` : ""}`).join(", ")}`));
    if (told.verification && Object.keys(told.verification).length) { const box = make("details"); box.append(make("summary", "Verification"), make("pre", JSON.stringify(told.verification, null, 1))); card.append(box); }
    if (!told.parameters || !Object.keys(told.parameters).length) return;
    const row = make("p"), soft = make("input", "", { type: "range", min: 1.2, max: 2.5, step: 0.05, "aria-label": "largest sensitivity peak" }), target = make("select", "", { "aria-label": "target of the export" });
    soft.value = 1.7;
    const read = make("output", "M_s 1.7");
    soft.addEventListener("input", () => { read.textContent = `M_s ${soft.value}`; });
    ["json", "px4-sih", "ardupilot", "gazebo", "mujoco", "rotorpy", "urdf", "matlab", "control", "fmu"].forEach((one) => target.append(make("option", one)));
    row.append("Softer ", soft, " sharper ", read, " ", make("button", "Tune", { onclick: () => start({ verb: "tune", results: [k], logs: [page.log], robustness: Number(soft.value) }) }), " ",
      target, " ", make("button", "Export", { onclick: () => start({ verb: "export", results: [k], logs: [], to: target.value }) }), " ",
      make("button", "Verify on the log shown", { onclick: () => start({ verb: "verify", results: [k], logs: [page.log] }) }));
    card.append(row);
  },
  tune(card, told) {
    for (const [axis, one] of Object.entries(told.axes ?? {})) {
      card.append(make("h3", axis), tableOf(["parameter", "flown", "proposed"], Object.entries(one.gains).map(([name, gain]) => [name, number(gain.flown), number(gain.proposed)])));
      const margins = Object.keys(one.flown ?? {}).filter((name) => one.proposed?.[name]);
      card.append(tableOf(["rate loop", "flown", "proposed"], margins.map((name) => [name.replaceAll("_", " "), interval(one.flown[name]), interval(one.proposed[name])])));
    }
  },
  export(card, told) { card.append(tableOf(["quantity", "identified", "exported", "unit"], told.quantities.map((one) => [one.name, number(one.identified), number(one.exported), one.unit]))); },
  review(card, told) {
    for (const one of told.reviews ?? [told]) {
      card.append(tableOf(["loop", "bandwidth in rad/s", "delay in s", "overshoot in %"], Object.entries(one.loops ?? {}).map(([name, loop]) => [name, interval(loop.bandwidth_3db_rad_s), interval(loop.delay_s), interval(loop.overshoot_percent)])));
      card.append(tableOf(["axis", "phase margin in deg", "gain margin in dB"], Object.entries(one.margins ?? {}).map(([name, margin]) => [name, interval(margin.phase_margin_deg), interval(margin.gain_margin_db)])));
      const list = make("ul"); (one.cannot_tell ?? []).forEach((row) => list.append(make("li", `${row.what}: ${row.why} ${row.remedy ?? ""}`)));
      const box = make("details"); box.append(make("summary", "What it cannot tell"), list); card.append(box);
    }
  },
  response() {},
  verify(card, told) { const box = make("details", "", { open: "" }); box.append(make("summary", "Scores"), make("pre", JSON.stringify(told.verification ?? told, null, 1).slice(0, 6000))); card.append(box); },
};
const start = tried(async (step) => { await post("/api/steps", step); say(""); await refresh(); });
const showStep = tried(async (k) => {
  const row = page.state.steps[k - 1], card = $(`step-${k}`), mark = `${row.state}`;
  if (page.shown[k] !== mark) {
    page.shown[k] = mark;
    card.replaceChildren(make("h3", `${k}. ${row.step.verb} ${row.step.models.join(", ")}`), make("code", row.command.join(" ")), make("p", "", { class: "told", role: "status" }));
    if (row.state === "running" || row.state === "waiting") card.append(make("button", "Cancel", { onclick: tried(async () => { await ask(`/api/steps/${k}`, { method: "DELETE" }); await refresh(); }) }));
    else {
      const told = await ask(`/api/steps/${k}`);
      if (told.document) { shows[row.step.verb](card, told.document, k); showCurves(card, told.curves); card.append(findingsOf(told.document.findings)); }
      const files = make("p", told.files.length ? "Files: " : "");
      told.files.forEach((name, n) => files.append(make("a", name, { href: `/api/steps/${k}/files/${n}`, download: name.split("/").at(-1) }), " "));
      card.append(files);
    }
  }
  card.dataset.state = row.state;
  const line = card.querySelector(".told");
  line.textContent = row.state === "done" ? "" : row.sentence || `${row.state}${row.told ? `: ${row.told}` : ""}${row.share === null ? "" : ` ${Math.round(100 * row.share)} %`}`;
  line.className = `told${["refused", "failed"].includes(row.state) ? " bad" : ""}`;
});
const redraw = () => { page.shown = {}; page.state.steps.forEach((_, k) => showStep(k + 1)); document.querySelectorAll(".unit").forEach((one) => { one.textContent = unitText(); }); showChoice(); };

const refresh = tried(async () => {
  const state = page.state = await ask("/api/state");
  $("logs").replaceChildren(...state.logs.map((one, k) => {
    const row = make("li", `${one.name} `);
    if (one.state === "done") row.append(make("button", "See", { onclick: () => showLog(k + 1) }));
    else row.append(make("span", one.sentence || `${one.state} ${one.told}`, one.sentence ? { class: "bad" } : {}));
    return row;
  }));
  const ready = state.logs.map((one, k) => [one, k + 1]).filter(([one]) => one.state === "done");
  if ($("log").options.length !== ready.length) $("log").replaceChildren(...ready.map(([one, k]) => make("option", one.name, { value: k })));
  if (!page.log && ready.length) { page.log = ready[0][1]; say(""); await showLog(page.log); }
  $("results").hidden = !state.steps.length;
  for (let k = 1; k <= state.steps.length; k += 1) {
    if (!$(`step-${k}`)) { const card = make("article", "", { class: "card", id: `step-${k}` }); $("steps").prepend(card); }
    await showStep(k);
  }
  $("waiting").hidden = !state.waiting.length || state.steps.length > 0;
  if (state.folder && !$("folder").options.length) {
    const found = await ask("/api/folder");
    $("folder").replaceChildren(...found.map((name) => make("option", name, { value: name })));
    $("folder-label").hidden = !found.length;
  }
});
const busy = () => [...page.state.logs, ...page.state.steps].some((one) => ["waiting", "running"].includes(one.state)) || page.demo;
const watch = async () => { if (busy() && !document.hidden) await refresh(); setTimeout(watch, 400); };

$("file").addEventListener("change", () => upload($("file").files));
for (const kind of ["dragover", "dragleave", "drop"]) document.addEventListener(kind, (event) => { event.preventDefault(); $("drop").classList.toggle("over", kind === "dragover"); });
document.addEventListener("drop", (event) => upload(event.dataTransfer.files));
$("demo").addEventListener("click", tried(async () => { await post("/api/demo", {}); say("flying the demonstration: a minute"); page.demo = true; setTimeout(() => { page.demo = false; }, 300000); }));
$("choose").addEventListener("click", tried(async () => { await post("/api/open", { name: $("folder").value }); await refresh(); }));
$("log").addEventListener("change", () => showLog(Number($("log").value)));
$("add").addEventListener("click", () => addTrack(Number($("channel").value)));
$("whole").addEventListener("click", () => { const one = page.told[page.log].inspection; moved(one.start_s, one.stop_s); });
$("spectrum").addEventListener("click", spectra("spectrum"));
$("spectrogram").addEventListener("click", spectra("spectrogram"));
for (const name of ["inputs", "outputs", "instrument"]) $(name).addEventListener("change", () => choose({ [name]: $(name).value }));
const typed = () => { const low = Number($("low").value), high = Number($("high").value); if (low > 0 && high > low) choose({ band: [omegaOf(low), omegaOf(high)] }); };
$("low").addEventListener("change", typed); $("high").addEventListener("change", typed);
$("no-band").addEventListener("click", () => choose({ band: null }));
$("model").addEventListener("change", () => choose({ model: $("model").value }));
for (const verb of ["review", "response", "identify"]) $(`run-${verb}`).addEventListener("click", () => start(stepOf(verb)));
$("waiting").addEventListener("click", tried(async () => {
  for (const step of page.state.waiting) {
    await start(step);
    while (page.state.steps.some((one) => ["waiting", "running"].includes(one.state))) { await new Promise((done) => setTimeout(done, 500)); await refresh(); }
  }
}));
$("copy").addEventListener("click", tried(async () => { await navigator.clipboard.writeText($("command").textContent); say("copied"); }));
$("undo").addEventListener("click", undo);
$("units").addEventListener("change", redraw); $("scale").addEventListener("change", redraw);
$("theme").addEventListener("click", () => { const root = document.documentElement, dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches; root.dataset.theme = dark ? "light" : "dark"; if (page.log) showLog(page.log); redraw(); });
document.addEventListener("keydown", (event) => { if ((event.ctrlKey || event.metaKey) && event.key === "z" && !["INPUT", "SELECT"].includes(document.activeElement.tagName)) { event.preventDefault(); undo(); } });
await refresh();
watch();
