"use strict";
// The page of a fleet: population and histories are drawn when they are chosen, and of the table what can be seen.
(() => {
  const source = document.getElementById("loops");
  if (!source) return;
  const { vehicles, logs, findings, series, populations } = JSON.parse(source.textContent);
  // Colors of all pictures: measured, out of line, the third.
  const [USUAL, ODD, CHANGED] = rotorid.template().layout.colorway;
  const parameters = document.getElementById("fleet-parameter");
  const vehicle = document.getElementById("fleet-vehicle");
  const filter = document.getElementById("fleet-filter");
  const place = document.getElementById("fleet-table");
  const shown = document.getElementById("fleet-shown");
  if (!populations.length) return;

  const option = (select, value, words) => {
    const one = document.createElement("option");
    one.value = String(value);
    one.textContent = words;
    select.append(one);
  };
  populations.forEach((one, k) => option(parameters, k, `${one.model} · ${one.parameter}`));
  const names = vehicles.map((name, k) => k).sort((a, b) => vehicles[a].localeCompare(vehicles[b], "en", { numeric: true }));
  const marked = new Set(series.filter((one) => one.changes.length || one.odd_vehicle).map((one) => one.vehicle));
  for (const k of names) option(vehicle, k, marked.has(k) ? `${vehicles[k]} (see changes)` : vehicles[k]);
  const first = names.find((k) => marked.has(k));
  if (first !== undefined) vehicle.value = String(first);
  const telling = series.find((one) => one.vehicle === first && one.changes.length) ?? series.find((one) => one.vehicle === first && one.odd_vehicle);
  if (telling) {
    parameters.value = String(populations.findIndex((one) => one.model === telling.model && one.parameter === telling.parameter));
  }

  const chosen = () => populations[Number(parameters.value)];
  const of = (one) => series.filter((two) => two.model === one.model && two.parameter === one.parameter);
  const axis = (one) => (one.unit ? `${one.parameter} [${one.unit}]` : one.parameter);
  // Too few flights have no normal range.
  const band = (one, name) => (one.low === null ? [] : [{
    type: "rect", xref: "paper", x0: 0, x1: 1, yref: "y", y0: one.low, y1: one.high, line: { width: 0 },
    fillcolor: USUAL, opacity: 0.12, layer: "below", name,
  }]);
  const reach = (values, ends) => ({
    type: "data", symmetric: false, thickness: 1, width: 0,
    array: ends.map(([, high], k) => (high ?? values[k]) - values[k]),
    arrayminus: ends.map(([low], k) => values[k] - (low ?? values[k])),
  });

  const frame = { height: 320, margin: { l: 70, r: 20, t: 56, b: 50 }, hovermode: "closest" };
  const legend = { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" };
  const population = () => {
    const one = chosen();
    const many = of(one).filter((two) => two.level)
      .map((two) => ({ value: two.level[0], ends: two.level.slice(1), series: two })).sort((a, b) => a.value - b.value);
    const words = (two) => vehicles[two.series.vehicle];
    const group = (keep, symbol, color, name) => {
      const part = many.map((two, k) => [two, k]).filter(([two]) => keep(two));
      return {
        type: many.length > 400 ? "scattergl" : "scatter", mode: "markers", name,
        x: part.map(([, k]) => k + 1), y: part.map(([two]) => two.value), text: part.map(([two]) => words(two)),
        error_y: reach(part.map(([two]) => two.value), part.map(([two]) => two.ends)),
        marker: { symbol, color, size: 8 }, hovertemplate: "%{text}: %{y:.5g}<extra></extra>",
      };
    };
    const odd = (two) => two.series.odd_vehicle;
    const changed = (two) => two.series.changes.length > 0 && !odd(two);
    const open = (two) => two.series.verdict === "undecided" && !odd(two);
    const lines = [
      group((two) => !odd(two) && !changed(two) && !open(two), "circle", USUAL, "no change found"),
      group(open, "circle-open", USUAL, "not enough data to see a change"),
      group(changed, "diamond", CHANGED, "changed (before it)"),
      group(odd, "x", ODD, "differs"),
    ].filter((line) => line.x.length);
    const layout = {
      ...frame, legend, shapes: band(one, "normal"),
      xaxis: { title: { text: "vehicles, in the order of their values" }, zeroline: false, range: [0, many.length + 1] },
      yaxis: { title: { text: axis(one) }, zeroline: false },
    };
    return { data: lines, layout };
  };

  const history = () => {
    const one = chosen();
    const who = Number(vehicle.value);
    const found = of(one).find((two) => two.vehicle === who);
    const y = found ? found.value : [];
    const x = y.map((_, k) => k + 1);
    const odd = new Set(found ? found.odd : []);
    const point = (keep, symbol, color, name) => ({
      type: y.length > 1000 ? "scattergl" : "scatter", mode: "markers", name,
      x: x.filter(keep), y: y.filter((_, k) => keep(k + 1)),
      text: x.filter(keep).map((k) => logs[found.log[k - 1]]),
      error_y: reach(y.filter((_, k) => keep(k + 1)), x.filter(keep).map((k) => found.ends[k - 1])),
      marker: { symbol, color, size: 7 }, hovertemplate: "flight %{x}, %{text}: %{y:.5g}<extra></extra>",
    });
    const lines = [];
    if (found) {
      lines.push(point((k) => !odd.has(k), "circle", USUAL, "flights, 95 %"));
      if (odd.size) lines.push(point((k) => odd.has(k), "x", ODD, "odd flight"));
      found.changes.forEach((change, k) => {
        if (k === 0) lines.push(level(change.from, change.at - 1, change.before, false));
        lines.push(level(change.at, change.to, change.after, k > 0));
      });
    }
    const changes = (found ? found.changes : []).map((change) => ({
      type: "line", xref: "x", x0: change.at - 0.5, x1: change.at - 0.5, yref: "paper", y0: 0, y1: 1,
      line: { color: ODD, dash: "dot", width: 1.5 },
    }));
    const layout = {
      ...frame, legend, shapes: [...band(one, "normal"), ...changes],
      xaxis: { title: { text: `flights of ${vehicles[who]}` }, zeroline: false },
      yaxis: { title: { text: axis(one) }, zeroline: false },
      annotations: found ? [] : [{ text: "no such number of this vehicle", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }],
    };
    return { data: lines, layout };
  };
  const level = (start, stop, value, quiet) => ({
    type: "scatter", mode: "lines", name: "mean", showlegend: !quiet && start === 1, x: [start - 0.5, stop + 0.5], y: [value, value],
    line: { color: CHANGED, width: 2 }, hoverinfo: "skip",
  });

  // The table: of all lines only those that can be seen are in the page.
  const HEIGHT = 30;
  const lines = [];
  series.forEach((one) => one.value.forEach((value, k) => lines.push([one, k])));
  const COLUMNS = [
    ["Vehicle", ([one]) => vehicles[one.vehicle]],
    ["Flight", ([, k]) => k + 1],
    ["Log", ([one, k]) => logs[one.log[k]]],
    ["Time", ([one, k]) => one.time[k] ?? ""],
    ["Model", ([one]) => one.model],
    ["Parameter", ([one]) => one.parameter],
    ["Value", ([one, k]) => one.value[k]],
    ["± std", ([one, k]) => one.std[k]],
    ["Unit", ([one]) => one.unit],
    ["Findings", ([one, k]) => findings[one.findings[k]]],
  ];
  const NUMBERS = new Set(["Flight", "Value", "± std"]);
  let order = lines;
  let sorted = { column: -1, up: true };
  const table = document.createElement("table");
  const head = table.createTHead().insertRow();
  const buttons = COLUMNS.map(([name], column) => {
    const cell = document.createElement("th");
    cell.scope = "col";
    if (NUMBERS.has(name)) cell.className = "number";
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = name;
    button.addEventListener("click", () => sort(column));
    cell.append(button);
    head.append(cell);
    return cell;
  });
  const above = table.createTBody();
  const body = table.createTBody();
  const below = table.createTBody();
  const spacer = (part) => {
    const cell = part.insertRow().insertCell();
    cell.colSpan = COLUMNS.length;
    cell.className = "spacer";
    return cell;
  };
  const [top, bottom] = [spacer(above), spacer(below)];
  place.append(table);

  const show = () => {
    const start = Math.max(Math.floor(place.scrollTop / HEIGHT) - 10, 0);
    const stop = Math.min(start + Math.ceil((place.clientHeight || 400) / HEIGHT) + 20, order.length);
    top.style.height = `${start * HEIGHT}px`;
    bottom.style.height = `${(order.length - stop) * HEIGHT}px`;
    body.replaceChildren(...order.slice(start, stop).map((line) => {
      const row = document.createElement("tr");
      COLUMNS.forEach(([name, read]) => {
        const cell = row.insertCell();
        const value = read(line);
        cell.textContent = typeof value === "number" && name !== "Flight" ? String(Number(value.toPrecision(name === "Value" ? 5 : 2))).replace("-", "−") : value ?? "–";
        if (NUMBERS.has(name)) cell.className = "number";
      });
      return row;
    }));
  };
  const collator = new Intl.Collator("en", { numeric: true });
  const arrange = () => {
    const wanted = filter.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    order = lines.filter(([one, k]) => {
      const text = `${vehicles[one.vehicle]} ${logs[one.log[k]]} ${one.model} ${one.parameter} ${findings[one.findings[k]]}`.toLowerCase();
      return wanted.every((word) => text.includes(word));
    });
    if (sorted.column >= 0) {
      const read = COLUMNS[sorted.column][1];
      const keyed = order.map((line) => [read(line), line]);
      const numeric = NUMBERS.has(COLUMNS[sorted.column][0]);
      keyed.sort(([a], [b]) => (numeric ? a - b : collator.compare(a, b)));
      if (!sorted.up) keyed.reverse();
      order = keyed.map(([, line]) => line);
    }
    place.scrollTop = 0;
    shown.textContent = `${order.length} of ${lines.length} lines`;
    show();
  };
  const sort = (column) => {
    sorted = { column, up: sorted.column === column ? !sorted.up : true };
    buttons.forEach((cell, k) => {
      if (k === column) cell.setAttribute("aria-sort", sorted.up ? "ascending" : "descending");
      else cell.removeAttribute("aria-sort");
    });
    arrange();
  };
  let waiting = 0;
  place.addEventListener("scroll", () => {
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(show);
  });
  filter.addEventListener("input", arrange);

  for (const part of document.querySelectorAll("[data-needs-script]")) part.hidden = false;
  Object.assign(rotorid.pictures, { "fleet-population": population, "fleet-history": history });
  const places = Object.fromEntries(["fleet-population", "fleet-history"].map((key) => [key, document.getElementById(key)]));
  const draw = (...keys) => rotorid.redraw(keys.map((key) => places[key]));
  parameters.addEventListener("change", () => draw("fleet-population", "fleet-history"));
  vehicle.addEventListener("change", () => draw("fleet-history"));
  arrange();
  draw("fleet-population", "fleet-history").then(
    () => {
      places["fleet-population"].on("plotly_click", ({ points }) => {
        const k = vehicles.indexOf(points[0].text);
        if (k < 0) return;
        vehicle.value = String(k);
        draw("fleet-history");
      });
      document.documentElement.dataset.fleet = "ready";
    },
  );
})();
