// Pictures: tracks with bands and a brush, spectra, responses. They draw what they are given and compute nothing.
const COLORS = ["#1f77b4", "#d9480f", "#2b8a3e", "#9c36b5", "#c2255c", "#0b7285"];
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const phaseOf = (re, im) => {
  let before = null, turn = 0;
  return re.map((x, k) => {
    if (x === null || im[k] === null) return null;
    let angle = Math.atan2(im[k], x) * 180 / Math.PI + turn;
    if (before !== null) while (angle - before > 180) { angle -= 360; turn -= 360; }
    if (before !== null) while (angle - before < -180) { angle += 360; turn += 360; }
    return (before = angle);
  });
};
const axis = (label) => ({ label, stroke: style("--fore"), grid: { stroke: style("--line"), width: 0.5 }, ticks: { stroke: style("--line") }, labelSize: 18, size: 46 });
const width = (box) => {
  const { paddingLeft, paddingRight } = getComputedStyle(box);
  return Math.max(Math.min((box.clientWidth || 320) - parseFloat(paddingLeft) - parseFloat(paddingRight), 1260), 200);
};

export function track(box, { title, unit, data, bands, brush, zoom, moved }) {
  let own = true;
  const draw = (u) => {
    for (const { start, stop, color } of bands()) {
      const a = Math.max(u.valToPos(start, "x", true), u.bbox.left), b = Math.min(u.valToPos(stop, "x", true), u.bbox.left + u.bbox.width);
      if (b <= a) continue;
      u.ctx.fillStyle = color;
      u.ctx.fillRect(a, u.bbox.top, b - a, u.bbox.height);
    }
  };
  const plot = new uPlot({
    title, width: width(box), height: 170, legend: { show: false }, cursor: { drag: { x: true, y: false, setScale: false } },
    scales: { x: { time: false } },
    axes: [axis("time in s"), axis(unit === "1" ? "" : unit)],
    series: [{}, { stroke: COLORS[0], width: 1, points: { show: false } }],
    hooks: { drawClear: [draw], setSelect: [(u) => {
      if (!own || u.select.width < 3) return;
      const start = u.posToVal(u.select.left, "x"), stop = u.posToVal(u.select.left + u.select.width, "x");
      own = false; u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false); own = true;
      (zoom() ? moved : brush)(start, stop);
    }] },
  }, data, box);
  plot.over.addEventListener("wheel", (event) => {
    event.preventDefault();
    const { min, max } = plot.scales.x, at = plot.posToVal(event.offsetX, "x"), by = event.deltaY > 0 ? 1.3 : 1 / 1.3;
    moved(at - (at - min) * by, at + (max - at) * by);
  }, { passive: false });
  plot.root.setAttribute("role", "img"); plot.root.setAttribute("aria-label", title);
  return plot;
}

export function lines(box, { title, x, rows, xLabel, yLabel, log = true, logY = false, brush = null }) {
  const plot = new uPlot({
    title, width: width(box), height: 210, legend: { show: rows.length > 1 }, cursor: { drag: { x: !!brush, y: false, setScale: false } },
    scales: { x: { time: false, distr: log ? 3 : 1 }, y: { distr: logY ? 3 : 1 } },
    axes: [axis(xLabel), axis(yLabel)],
    series: [{ label: xLabel }, ...rows.map((row, k) => ({ label: row.label, stroke: COLORS[k % COLORS.length], width: row.dash ? 1 : 1.6, dash: row.dash, points: { show: false } }))],
    hooks: { setSelect: [(u) => { if (brush && u.select.width > 3) brush(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")); }] },
  }, [x, ...rows.map((row) => row.y)], box);
  plot.root.setAttribute("role", "img"); plot.root.setAttribute("aria-label", title);
  return plot;
}

export function gram(box, told, label) {
  const canvas = document.createElement("canvas"), rows = told.density_db, columns = told.time_s.length;
  canvas.className = "gram"; canvas.width = columns; canvas.height = rows.length;
  canvas.setAttribute("role", "img"); canvas.setAttribute("aria-label", label);
  const flat = rows.flat().sort((a, b) => a - b), low = flat[Math.floor(flat.length * 0.05)], high = flat[flat.length - 1];
  const context = canvas.getContext("2d"), image = context.createImageData(columns, rows.length);
  rows.forEach((row, k) => row.forEach((value, n) => {
    const s = Math.max(0, Math.min(1, (value - low) / (high - low || 1))), at = 4 * ((rows.length - 1 - k) * columns + n);
    image.data.set([255 * Math.min(1, 1.6 * s), 255 * s * s, 255 * (0.35 + 0.4 * s - 0.6 * s * s), 255], at);
  }));
  context.putImageData(image, 0, 0);
  box.append(canvas);
}
