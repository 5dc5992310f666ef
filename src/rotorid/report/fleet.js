"use strict";
// The page of a fleet: draws the chosen quantity over the fleet and over one vehicle's flights, and the visible lines of
// the table.
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

  const option = (select, value, text) => {
    const added = document.createElement("option");
    added.value = String(value);
    added.textContent = text;
    select.append(added);
  };
  const byName = populations.map((_, k) => k).sort((a, b) => populations[a].parameter.localeCompare(populations[b].parameter, "en", { numeric: true }));
  for (const k of byName) option(parameters, k, populations.filter((other) => other.parameter === populations[k].parameter).length > 1 ? `${populations[k].parameter} (${populations[k].model})` : populations[k].parameter);
  const names = vehicles.map((name, k) => k).sort((a, b) => vehicles[a].localeCompare(vehicles[b], "en", { numeric: true }));
  const marked = new Set(series.filter((history) => history.changes.length || history.odd_vehicle).map((history) => history.vehicle));
  for (const k of names) option(vehicle, k, marked.has(k) ? `${vehicles[k]} (changed or unlike others)` : vehicles[k]);
  const first = names.find((k) => marked.has(k));
  if (first !== undefined) vehicle.value = String(first);
  const alike = (a, b) => a.model === b.model && a.parameter === b.parameter;
  const found = series.find((history) => history.vehicle === first && history.changes.length) ?? series.find((history) => history.vehicle === first && history.odd_vehicle);
  if (found) parameters.value = String(populations.findIndex((quantity) => alike(quantity, found)));

  const chosen = () => populations[Number(parameters.value)];
  const historiesOf = (quantity) => series.filter((history) => alike(history, quantity));
  const axis = ({ parameter, unit }) => (unit ? `${parameter} [${unit}]` : parameter);
  // Too few flights have no normal range.
  const band = ({ low, high }, name) => (low === null ? [] : [{
    type: "rect", xref: "paper", x0: 0, x1: 1, yref: "y", y0: low, y1: high, line: { width: 0 },
    fillcolor: USUAL, opacity: 0.12, layer: "below", name,
  }]);
  // A normal range of few flights may be so wide that nothing else could be read: the axis then ends near the data.
  const range = ({ low, high }, ends) => {
    const all = ends.flat().filter((end) => end !== null);
    const [bottom, top] = [Math.min(...all), Math.max(...all)], room = top - bottom || Math.abs(top) || 1;
    const [from, to] = [Math.max(low ?? bottom, bottom - room), Math.min(high ?? top, top + room)];
    return all.length ? [Math.min(from, bottom) - 0.06 * room, Math.max(to, top) + 0.06 * room] : undefined;
  };
  const reach = (values, ends) => ({
    type: "data", symmetric: false, thickness: 1, width: 0,
    array: ends.map(([, high], k) => (high ?? values[k]) - values[k]),
    arrayminus: ends.map(([low], k) => values[k] - (low ?? values[k])),
  });

  const frame = { height: 320, margin: { l: 70, r: 20, t: 56, b: 50 }, hovermode: "closest" };
  const legend = { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" };
  const population = () => {
    const quantity = chosen();
    const points = historiesOf(quantity).filter((history) => history.level).sort((a, b) => a.level[0] - b.level[0]);
    const group = (keep, symbol, color, name) => {
      const part = points.map((history, k) => [history, k + 1]).filter(([history]) => keep(history));
      const y = part.map(([{ level }]) => level[0]);
      return {
        type: points.length > 400 ? "scattergl" : "scatter", mode: "markers", name,
        x: part.map(([, k]) => k), y, text: part.map(([history]) => vehicles[history.vehicle]),
        customdata: part.map(([history]) => history.level_text),
        error_y: reach(y, part.map(([{ level }]) => level.slice(1))),
        marker: { symbol, color, size: 8 }, hovertemplate: "%{text}: %{customdata}<extra></extra>",
      };
    };
    const odd = (history) => history.odd_vehicle;
    const changed = (history) => history.changes.length > 0 && !odd(history);
    const open = (history) => history.verdict === "undecided" && !odd(history);
    const lines = [
      group((history) => !odd(history) && !changed(history) && !open(history), "circle", USUAL, "no change found"),
      group(open, "circle-open", USUAL, "not enough data to detect a change"),
      group(changed, "diamond", CHANGED, "changed (value before)"),
      group(odd, "x", ODD, "unlike the others"),
    ].filter((line) => line.x.length);
    const layout = {
      ...frame, legend, shapes: band(quantity, "normal"),
      xaxis: { title: { text: "vehicles, sorted by value" }, zeroline: false, range: [0, points.length + 1], ...(points.length < 8 ? { dtick: 1 } : {}) },
      yaxis: { title: { text: axis(quantity) }, zeroline: false, range: range(quantity, points.map((history) => history.level)) },
    };
    return { data: lines, layout };
  };

  const history = () => {
    const quantity = chosen();
    const who = Number(vehicle.value);
    const own = historiesOf(quantity).find((other) => other.vehicle === who);
    const y = own ? own.value : [];
    const x = y.map((_, k) => k + 1);
    const odd = new Set(own ? own.odd : []);
    const point = (keep, symbol, color, name) => ({
      type: y.length > 1000 ? "scattergl" : "scatter", mode: "markers", name,
      x: x.filter(keep), y: y.filter((_, k) => keep(k + 1)),
      text: x.filter(keep).map((k) => logs[own.log[k - 1]]), customdata: x.filter(keep).map((k) => own.text[k - 1]),
      error_y: reach(y.filter((_, k) => keep(k + 1)), x.filter(keep).map((k) => own.ends[k - 1])),
      marker: { symbol, color, size: 7 }, hovertemplate: "flight %{x}, %{text}: %{customdata}<extra></extra>",
    });
    const lines = [];
    if (own) {
      lines.push(point((k) => !odd.has(k), "circle", USUAL, "flights, 95 % intervals"));
      if (odd.size) lines.push(point((k) => odd.has(k), "x", ODD, "odd flight"));
      own.changes.forEach((change, k) => {
        if (k === 0) lines.push(level(change.from, change.at - 1, change.before, false));
        lines.push(level(change.at, change.to, change.after, k > 0));
      });
    }
    const changes = (own ? own.changes : []).map((change) => ({
      type: "line", xref: "x", x0: change.at - 0.5, x1: change.at - 0.5, yref: "paper", y0: 0, y1: 1,
      line: { color: ODD, dash: "dot", width: 1.5 },
    }));
    const layout = {
      ...frame, legend, shapes: [...band(quantity, "normal"), ...changes],
      xaxis: { title: { text: `flights of ${vehicles[who]}` }, zeroline: false, ...(y.length < 8 ? { dtick: 1 } : {}) },
      yaxis: { title: { text: axis(quantity) }, zeroline: false, range: range(quantity, [y, ...(own ? own.ends : [])]) },
      annotations: own ? [] : [{ text: "this vehicle has no such value", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }],
    };
    return { data: lines, layout };
  };
  const level = (start, stop, value, quiet) => ({
    type: "scatter", mode: "lines", name: "mean", showlegend: !quiet && start === 1, x: [start - 0.5, stop + 0.5], y: [value, value],
    line: { color: CHANGED, width: 2 }, hoverinfo: "skip",
  });

  // The table: only the lines that are visible are in the page.
  const HEIGHT = 30;
  const lines = series.flatMap((history) => history.value.map((_, k) => [history, k]));
  const COLUMNS = [
    ["Vehicle", ([history]) => vehicles[history.vehicle]],
    ["Flight", ([, k]) => k + 1],
    ["Log", ([history, k]) => logs[history.log[k]]],
    ["Time", ([history, k]) => history.time[k] ?? ""],
    ["Model", ([history]) => history.model],
    ["Quantity", ([history]) => history.parameter],
    ["Value ± std", ([history, k]) => history.value[k], ([history, k]) => history.text[k]],
    ["Unit", ([history]) => history.unit],
    ["Warnings", ([history, k]) => findings[history.findings[k]]],
  ];
  const NUMBERS = new Set(["Flight", "Value ± std"]);
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
      COLUMNS.forEach(([name, read, write]) => {
        const cell = row.insertCell();
        cell.textContent = (write ?? read)(line);
        if (NUMBERS.has(name)) cell.className = "number";
      });
      return row;
    }));
  };
  const collator = new Intl.Collator("en", { numeric: true });
  const arrange = () => {
    const wanted = filter.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    order = lines.filter(([history, k]) => {
      const text = `${vehicles[history.vehicle]} ${logs[history.log[k]]} ${history.model} ${history.parameter} ${findings[history.findings[k]]}`.toLowerCase();
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
  const pictures = Object.fromEntries(["fleet-population", "fleet-history"].map((key) => [key, document.getElementById(key)]));
  const draw = (...keys) => rotorid.redraw(keys.map((key) => pictures[key]));
  place.closest("details").addEventListener("toggle", arrange);
  parameters.addEventListener("change", () => draw("fleet-population", "fleet-history"));
  vehicle.addEventListener("change", () => draw("fleet-history"));
  arrange();
  draw("fleet-population", "fleet-history").then(
    () => {
      pictures["fleet-population"].on("plotly_click", ({ points }) => {
        const k = vehicles.indexOf(points[0].text);
        if (k < 0) return;
        vehicle.value = String(k);
        draw("fleet-history");
      });
      document.documentElement.dataset.fleet = "ready";
    },
  );
})();
