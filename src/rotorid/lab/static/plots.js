// Pictures of responses and spectra. They draw what they are given and compute nothing.
import { make } from "./page.js";

const LINES = ["#1f77b4", "#d9480f", "#2b8a3e", "#9c36b5", "#c2255c", "#0b7285"];
const DARK_LINES = ["#6bb3ea", "#ff9a66", "#69c48a", "#cf9bea", "#f78fb3", "#66c7d6"];
export const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const isDark = () =>
  (document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
export const colors = () => (isDark() ? DARK_LINES : LINES);

export function phaseOf(re, im) {
  let before = null, turn = 0;
  return re.map((x, k) => {
    if (x === null || im[k] === null) return null;
    let angle = (Math.atan2(im[k], x) * 180) / Math.PI + turn;
    while (before !== null && angle - before > 180) { angle -= 360; turn -= 360; }
    while (before !== null && angle - before < -180) { angle += 360; turn += 360; }
    before = angle;
    return angle;
  });
}

export const axisOf = (label, size = 52) => ({
  label: label || undefined, labelSize: 16, size, font: "11px system-ui", labelFont: "11px system-ui",
  stroke: style("--quiet"), grid: { stroke: style("--line"), width: 0.6 }, ticks: { stroke: style("--line") },
});

export const widthOf = (box) => {
  const { paddingLeft, paddingRight } = getComputedStyle(box);
  return Math.max(Math.floor((box.clientWidth || 320) - parseFloat(paddingLeft) - parseFloat(paddingRight)), 200);
};

/** Curves over a logarithmic axis; a drag tells `brush` from where to where. Wide and narrow pages redraw it. */
export function lines(box, { title, x, rows, xLabel, yLabel, logY = false, brush = null, sync = null, height = 190 }) {
  const place = make("div");
  box.append(place);
  const palette = colors();
  const plot = new uPlot({
    title, width: widthOf(place), height, legend: { show: true, live: true },
    cursor: { drag: { x: Boolean(brush), y: false, setScale: false }, sync: sync ? { key: sync } : undefined },
    scales: { x: { time: false, distr: 3 }, y: { distr: logY ? 3 : 1 } },
    axes: [axisOf(xLabel, 34), axisOf(yLabel)],
    series: [{ label: xLabel, value: (_, v) => (v === null ? "–" : Number(v.toPrecision(4))) }, ...rows.map((row, k) => ({
      label: row.label, stroke: palette[k % palette.length], width: row.dash ? 1 : 1.6, dash: row.dash,
      points: { show: false }, value: (_, v) => (v === null ? "–" : Number(v.toPrecision(4))),
    }))],
    hooks: { setSelect: [(u) => {
      if (!brush || u.select.width <= 3) return;
      brush(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
      u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    }] },
  }, [x, ...rows.map((row) => row.y)], place);
  plot.root.setAttribute("role", "group");
  plot.root.setAttribute("aria-label", title);
  fitted(plot, place);
  return plot;
}

/** Keep a picture as wide as its place. */
export function fitted(plot, place) {
  const watcher = new ResizeObserver(() => {
    const width = widthOf(place);
    if (place.isConnected && place.clientWidth && Math.abs(width - plot.width) > 1) plot.setSize({ width, height: plot.height });
  });
  watcher.observe(place);
}

export function gram(box, told, label, frequencyText) {
  const rows = told.density_db, columns = told.time_s.length;
  const canvas = make("canvas");
  canvas.className = "gram";
  canvas.width = columns;
  canvas.height = rows.length;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  const flat = rows.flat().sort((a, b) => a - b), low = flat[Math.floor(flat.length * 0.05)], high = flat[flat.length - 1];
  const context = canvas.getContext("2d"), image = context.createImageData(columns, rows.length);
  rows.forEach((row, k) => row.forEach((value, n) => {
    const s = Math.max(0, Math.min(1, (value - low) / (high - low || 1)));
    image.data.set([255 * Math.min(1, 1.6 * s), 255 * s * s, 255 * (0.35 + 0.4 * s - 0.6 * s * s), 255], 4 * ((rows.length - 1 - k) * columns + n));
  }));
  context.putImageData(image, 0, 0);
  const above = make("div"), below = make("div");
  above.className = below.className = "gram-axis";
  const [lowest, highest] = frequencyText;
  above.append(make("span", `${highest} at the top`), make("span", `${Math.round(low)} to ${Math.round(high)} dB, dark to bright`));
  below.append(make("span", `${told.time_s[0].toFixed(1)} s`), make("span", `${lowest} at the bottom`), make("span", `${told.time_s[columns - 1].toFixed(1)} s`));
  box.append(above, canvas, below);
}

