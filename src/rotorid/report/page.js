"use strict";
// Draws the figures, in light or dark as the reader's system asks, and light on paper.
(() => {
  const { pictures, light, dark } = JSON.parse(document.getElementById("figures").textContent);
  const darkness = window.matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const buttons = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  const config = { responsive: true, displaylogo: false, modeBarButtons: buttons };

  const draw = (template) =>
    Promise.all(
      Array.from(document.querySelectorAll("[data-picture]"), (place) => {
        const { data, layout } = structuredClone(pictures[place.dataset.picture]);
        return Plotly.react(place, data, { ...layout, template }, config);
      }),
    );
  const redraw = () => draw(darkness.matches ? dark : light);

  redraw().then(
    () => { root.dataset.pictures = "drawn"; },
    (error) => { root.dataset.pictures = `failed: ${error}`; },
  );
  darkness.addEventListener("change", redraw);
  window.addEventListener("beforeprint", () => draw(light));
  window.addEventListener("afterprint", redraw);
})();
