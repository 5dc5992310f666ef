"use strict";
// Draws the figures, in light or dark as the reader's system asks, and light on paper, and in the units chosen.
(() => {
  const { pictures, light, dark } = JSON.parse(document.getElementById("figures").textContent);
  const darkness = window.matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const tools = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  const config = { responsive: true, displaylogo: false, modeBarButtons: tools };
  const switches = Array.from(document.querySelectorAll("button[data-unit]"));
  const units = { frequency: "rad/s", magnitude: "dB" };

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

  const draw = (template, places) =>
    Promise.all(
      places.map((place) => {
        const { data, layout } = structuredClone(seen(pictures[place.dataset.picture]));
        return Plotly.react(place, data, { ...layout, template }, config);
      }),
    );
  // In closed details a picture has no width yet; it is drawn when they open.
  const all = (part = document) =>
    Array.from(part.querySelectorAll("[data-picture]")).filter((place) => !place.closest("details:not([open])"));
  const say = (promise) =>
    promise.then(
      () => { root.dataset.pictures = "drawn"; },
      (error) => { root.dataset.pictures = `failed: ${error}`; },
    );
  const redraw = (places = all()) => say(draw(darkness.matches ? dark : light, places));

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
  for (const place of document.querySelectorAll(".scroll, pre")) {
    if (place.scrollWidth > place.clientWidth) place.tabIndex = 0;
  }

  redraw();
  darkness.addEventListener("change", () => redraw());
  window.addEventListener("beforeprint", () => draw(light, all()));
  window.addEventListener("afterprint", () => redraw());
})();
