"use strict";
// Draws the figures, in light or dark as the reader's system asks, and light on paper, and in the units chosen.
(() => {
  const { pictures, light, dark } = JSON.parse(document.getElementById("figures").textContent);
  const darkness = window.matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const tools = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  // Pictures are saved as they are printed: lines, not pixels.
  const saved = (place) => ({ format: "svg", filename: `${document.title} ${place.dataset.picture}`.replace(/[^\w.-]+/g, "-") });
  const config = (place) => ({ responsive: true, displaylogo: false, modeBarButtons: tools, toImageButtonOptions: saved(place) });
  const switches = Array.from(document.querySelectorAll("button[data-unit]"));
  const units = { frequency: root.dataset.frequency ?? "rad/s", magnitude: root.dataset.magnitude ?? "dB" };

  const each = (numbers, change) => numbers.map((number) => (number === null ? null : change(number)));
  const hertz = (omega) => omega / (2 * Math.PI);
  const factor = (decibels) => 10 ** (decibels / 20);

  // A trace comes in rad/s and, on the first axis, in dB. What is not a number is written by Python for each view.
  const converted = (trace, hovertemplate, leveled) => {
    const { x, y, customdata } = trace;
    const across = units.frequency === "Hz" ? { x: each(x, hertz), customdata: customdata && x } : { x };
    const high = leveled && units.magnitude === "linear" && trace.yaxis === "y" ? { y: each(y, factor) } : { y };
    return { ...trace, ...(hovertemplate ? { hovertemplate } : {}), ...across, ...high };
  };
  const seen = ({ data, layout, views }) => {
    if (!views) return { data, layout };
    const leveled = views[`${units.frequency} ${units.magnitude}`];
    const view = leveled ?? views[units.frequency];
    const convert = (trace, number) => converted(trace, view.hover[number], Boolean(leveled));
    return { data: view.data ?? data.map(convert), layout: view.layout };
  };

  const draw = (template, places, sized = (_, layout) => layout) =>
    Promise.all(
      places.map((place) => {
        const { data, layout } = structuredClone(seen(pictures[place.dataset.picture]));
        return Plotly.react(place, data, { ...sized(place, layout), template }, config(place));
      }),
    );
  // On paper responses stand two beside each other, and histories are as high as their panels need.
  const PAPER = { width: 700, half: 345, least: 230, most: 540 };
  const onPaper = (place, layout) => {
    const half = place.parentElement.closest(".pictures") !== null || Boolean(pictures[place.dataset.picture].views?.["rad/s dB"]);
    place.classList.toggle("half", half);
    const share = layout.yaxis2 ? 0.5 : 0.75, own = layout.height ?? 450;
    const height = Math.min(Math.max(Math.round(own * share), PAPER.least), PAPER.most);
    return { ...layout, width: half ? PAPER.half : PAPER.width, height, autosize: false, font: { ...layout.font, size: 8 } };
  };
  // In closed details a picture has no width yet; it is drawn when they open.
  const all = (part = document) =>
    Array.from(part.querySelectorAll("[data-picture]")).filter((place) => !place.closest("details:not([open])"));
  const say = (promise) =>
    promise.then(
      () => { root.dataset.pictures = "drawn"; },
      (error) => { root.dataset.pictures = `failed: ${error}`; },
    );
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : darkness.matches);
  const redraw = (places = all()) => say(draw(isDark() ? dark : light, places));

  const press = () => {
    for (const button of switches) {
      button.setAttribute("aria-pressed", String(units[button.dataset.unit] === button.value));
    }
  };
  const choose = ({ currentTarget: button }) => {
    units[button.dataset.unit] = button.value;
    press();
    redraw(all().filter((place) => pictures[place.dataset.picture].views));
  };
  for (const button of switches) button.addEventListener("click", choose);
  for (const group of document.querySelectorAll(".choices")) group.hidden = false;
  for (const details of document.querySelectorAll("details:has([data-picture])")) {
    details.addEventListener("toggle", () => redraw(all(details)));
  }
  press();
  // What scrolls sideways can be reached by keyboard.
  for (const place of document.querySelectorAll(".scroll, pre, nav")) {
    if (place.scrollWidth > place.clientWidth) place.tabIndex = 0;
  }

  // On a narrow screen a row becomes a card, in which every number stands beside the name of its column.
  const words = (cell) => cell.innerText.replace(/\s+/g, " ").trim();
  for (const table of document.querySelectorAll("table:has(thead)")) {
    const heads = Array.from(table.querySelectorAll("thead tr:last-child > *"), words);
    if (heads.length < 3 || table.closest(".fleet-table")) continue;
    table.classList.add("cards");
    for (const row of table.querySelectorAll("tbody tr")) {
      if (row.cells.length === heads.length) Array.from(row.cells, (cell, k) => { cell.dataset.head = heads[k]; });
    }
  }

  // A table as comma-separated values, for a spreadsheet.
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const separated = (table) =>
    Array.from(table.rows, (row) => Array.from(row.cells, (cell) => quoted(words(cell))).join(",")).join("\n");
  const copied = async (text) => {
    if (navigator.clipboard) return navigator.clipboard.writeText(text);
    const field = document.body.appendChild(document.createElement("textarea"));
    field.value = text;
    field.select();
    document.execCommand("copy");
    return field.remove();
  };
  for (const table of document.querySelectorAll(".scroll > table")) {
    if (table.rows.length < 3 || table.closest(".fleet-table")) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "copy";
    button.textContent = "Copy as CSV";
    button.addEventListener("click", async () => {
      try { await copied(separated(table)); button.textContent = "Copied"; } catch { button.textContent = "The browser refused"; }
      setTimeout(() => { button.textContent = "Copy as CSV"; }, 2000);
    });
    table.parentElement.after(button);
  }

  redraw();
  darkness.addEventListener("change", () => redraw());
  window.addEventListener("beforeprint", () => draw(light, all(), onPaper));
  window.addEventListener("afterprint", () => redraw());
})();
