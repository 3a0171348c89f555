"use strict";
// Draws the interactive charts of a diagnosis from the data embedded in the page. No library, no network.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const NS = "http://www.w3.org/2000/svg";
  const COLOURS = { reference: "var(--ink)", before: "var(--orange)", after: "var(--green)" };

  function element(parent, name, attributes, text) {
    const made = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes || {})) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  }

  function html(parent, name, className, text) {
    const made = document.createElement(name);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  }

  const minus = (text) => text.replace("-", "−");

  function written(value, unit) {
    if (value === null || value === undefined) return "–";
    if (unit === "rad") return minus(Number((value * 180 / Math.PI).toPrecision(3)).toString()) + "°";
    if (unit === "1") return minus(Number(value.toPrecision(3)).toString());
    for (const [factor, prefix] of [[1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]]) {
      if (Math.abs(value) >= factor) return minus(Number((value / factor).toPrecision(3)).toString()) + " " + prefix + unit;
    }
    return "0 " + unit;
  }

  function ticks(low, high, most) {
    const rough = (high - low) / most || 1;
    const power = Math.pow(10, Math.floor(Math.log10(rough)));
    const step = power * [1, 2, 5, 10].find((one) => one * power >= rough);
    const found = [];
    for (let tick = Math.ceil(low / step) * step; tick <= high + 1e-9 * step; tick += step) found.push(tick);
    return { found, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  }

  function extent(arrays) {
    let low = Infinity, high = -Infinity;
    for (const array of arrays) for (const value of array || []) {
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (low > high) return [0, 1];
    const pad = (high - low) * 0.06 || Math.abs(high) || 1e-9;
    return [low - pad, high + pad];
  }

  function line(parent, xs, ys, toX, toY, colour) {
    let path = "", on = false;
    for (let i = 0; i < xs.length; i++) {
      if (xs[i] === null || ys[i] === null) { on = false; continue; }
      path += (on ? "L" : "M") + toX(xs[i]).toFixed(1) + " " + toY(ys[i]).toFixed(1);
      on = true;
    }
    element(parent, "path", { class: "line", d: path, style: "stroke:" + colour });
  }

  // A frame with axes. `draw(plot)` fills it; `moved(x, y)` gives the readout; `chosen` takes a dragged box.
  function frame(host, options, draw, moved, chosen, reset) {
    const readout = html(host.parentNode, "p", "readout", options.hint);
    host.after(readout);
    let plot = null;
    function paint() {
      host.textContent = "";
      const width = Math.max(280, host.clientWidth), height = options.height(width);
      const svg = element(host, "svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": options.label });
      const area = { left: options.left || 62, right: width - 10, top: 8, bottom: height - 38 };
      const view = options.view(area);
      const toX = (x) => area.left + (x - view.x[0]) / (view.x[1] - view.x[0]) * (area.right - area.left);
      const toY = (y) => area.bottom - (y - view.y[0]) / (view.y[1] - view.y[0]) * (area.bottom - area.top);
      const across = ticks(view.x[0], view.x[1], width < 500 ? 4 : 8);
      for (const tick of across.found) {
        element(svg, "line", { class: "grid", x1: toX(tick), x2: toX(tick), y1: area.top, y2: area.bottom });
        element(svg, "text", { x: toX(tick), y: area.bottom + 17, "text-anchor": "middle" }, minus(tick.toFixed(across.decimals)));
      }
      element(svg, "text", { x: area.right, y: area.bottom + 34, "text-anchor": "end" }, options.xName);
      if (options.yName) {
        const up = ticks(view.y[0] / options.yScale, view.y[1] / options.yScale, 5);
        for (const tick of up.found) {
          const y = toY(tick * options.yScale);
          element(svg, "line", { class: "grid", x1: area.left, x2: area.right, y1: y, y2: y });
          element(svg, "text", { x: area.left - 8, y: y + 4, "text-anchor": "end" }, minus(tick.toFixed(up.decimals)));
        }
        element(svg, "text", { x: 0, y: area.bottom + 34 }, options.yName);
      }
      const clip = "clip-" + options.name;
      element(element(svg, "clipPath", { id: clip }), "rect",
        { x: area.left, y: area.top, width: area.right - area.left, height: area.bottom - area.top });
      const inside = element(svg, "g", { "clip-path": `url(#${clip})` });
      const overlay = element(svg, "g", {});
      plot = { svg, inside, overlay, area, view, toX, toY, width };
      draw(plot);
    }
    const at = (event) => {
      const box = plot.svg.getBoundingClientRect(), scale = plot.width / box.width;
      const px = (event.clientX - box.left) * scale, py = (event.clientY - box.top) * scale;
      const { area, view } = plot;
      return { px, py,
        x: view.x[0] + (px - area.left) / (area.right - area.left) * (view.x[1] - view.x[0]),
        y: view.y[0] + (area.bottom - py) / (area.bottom - area.top) * (view.y[1] - view.y[0]) };
    };
    let start = null;
    host.addEventListener("pointerdown", (event) => { start = at(event); });
    host.addEventListener("pointermove", (event) => {
      const here = at(event);
      readout.textContent = moved(here, plot) || options.hint;
      if (!start || !chosen || Math.abs(here.px - start.px) < 6) return;
      plot.overlay.textContent = "";
      const { area } = plot;
      element(plot.overlay, "rect", { class: "box", x: Math.min(start.px, here.px), width: Math.abs(here.px - start.px),
        y: options.bothWays ? Math.min(start.py, here.py) : area.top,
        height: options.bothWays ? Math.abs(here.py - start.py) : area.bottom - area.top });
    });
    host.addEventListener("pointerup", (event) => {
      const from = start, here = at(event);
      start = null;
      if (from && chosen && Math.abs(here.px - from.px) >= 6) chosen(from, here);
    });
    host.addEventListener("pointerleave", () => { start = null; crossAt(null); readout.textContent = options.hint; });
    if (reset) host.addEventListener("dblclick", reset);
    let asked = 0;
    new ResizeObserver(() => requestAnimationFrame(() => {
      if (host.clientWidth === asked) return;
      asked = host.clientWidth;
      paint();
    })).observe(host);
    return { paint: () => plot && paint(), cross: (t) => {
      if (!plot || start) return;
      plot.overlay.textContent = "";
      if (t === null || t < plot.view.x[0] || t > plot.view.x[1]) return;
      const x = plot.toX(t);
      element(plot.overlay, "line", { class: "cross", x1: x, x2: x, y1: plot.area.top, y2: plot.area.bottom });
    } };
  }

  // All charts over time share one stretch of it and one crosshair.
  const timed = [];
  let whole = [0, 1], shown = null;
  const crossAt = (t) => timed.forEach((chart) => chart.cross(t));
  const showTime = (from, to) => { shown = [Math.max(whole[0], from), Math.min(whole[1], to)]; timed.forEach((c) => c.paint()); };
  const dragTime = (a, b) => showTime(Math.min(a.x, b.x), Math.max(a.x, b.x));
  const wholeTime = () => showTime(whole[0], whole[1]);

  function startTime() {
    const ends = data.residuals.map((one) => [one.t[0], one.t[one.t.length - 1]]);
    if (data.map) ends.push([data.map.edges[0], data.map.edges[data.map.edges.length - 1]]);
    if (!ends.length) return;
    whole = [Math.min(...ends.map((e) => e[0])), Math.max(...ends.map((e) => e[1]))];
    shown = whole.slice();
  }

  function mapChart(host) {
    const { edges, stages, shares } = data.map;
    const largest = Math.max(...shares.flat()) || 1;
    const rows = stages.length + (data.segments.length ? 1 : 0), first = rows - stages.length;
    // Names that leave no room for the cells stand on them.
    const nameWidth = 14 + 7.2 * Math.max(9, ...stages.map((stage) => stage.length));
    const isOnCells = nameWidth > 0.3 * host.clientWidth;
    const rowName = (plot, y, name) => element(plot.svg, "text",
      isOnCells ? { x: plot.area.left + 6, y, style: "fill:var(--ink)" } : { x: nameWidth - 8, y, "text-anchor": "end" }, name);
    const options = { name: "map", label: "When each residual arises: its energy by time window", xName: "time [s]", left: isOnCells ? 10 : nameWidth,
      hint: "Point at a cell for its share. Drag to zoom in on time, double-click for all.",
      height: () => 54 + 34 * rows, view: () => ({ x: shown, y: [rows, 0] }) };
    function draw(plot) {
      data.segments.forEach((segment) => {
        const x = Math.max(plot.area.left, plot.toX(segment.start_s));
        const w = Math.min(plot.area.right, plot.toX(segment.stop_s)) - x;
        if (w <= 0) return;
        element(plot.inside, "rect", { x: x + 0.5, width: Math.max(0.5, w - 1), y: plot.toY(0) + 4, height: 24, style: "fill:var(--raised)" });
        if (w > 8 * segment.kind.length) {
          element(plot.inside, "text", { x: x + w / 2, y: plot.toY(0) + 21, "text-anchor": "middle" }, segment.kind);
        }
      });
      if (first && !isOnCells) rowName(plot, plot.toY(0) + 21, "manoeuvre");
      stages.forEach((stage, row) => {
        const y = plot.toY(row + first);
        shares[row].forEach((share, column) => {
          const x = plot.toX(edges[column]), w = plot.toX(edges[column + 1]) - x;
          element(plot.inside, "rect", { x: x + 0.5, width: Math.max(0.5, w - 1), y: y + 1, height: 32, style:
            `fill:var(--blue);opacity:${(0.06 + 0.94 * share / largest).toFixed(3)}` });
        });
        rowName(plot, y + 21, stage);
      });
    }
    function moved(here) {
      crossAt(here.x);
      const row = Math.floor(here.y) - first, column = edges.findIndex((edge, i) => edge <= here.x && here.x < edges[i + 1]);
      if (row < 0 || row >= stages.length || column < 0) return "";
      const share = (100 * shares[row][column]).toFixed(1);
      return `${stages[row]}, ${edges[column].toFixed(1)} to ${edges[column + 1].toFixed(1)} s: ${share} % of this residual's energy arises here`;
    }
    timed.push(frame(host, options, draw, moved, dragTime, wholeTime));
  }

  function residualChart(host, series, place) {
    let bounds = extent([series.value, series.explained]);
    let largest = Math.max(Math.abs(bounds[0]), Math.abs(bounds[1]));
    const turn = series.unit === "rad", counted = series.unit === "1";
    const least = counted ? 1 : 1e-9;  // what is smaller is a rounding, and drawn flat
    if (largest < least) { bounds = [-least, least]; largest = least; }
    const whole = turn ? Math.PI / 180 : 1;
    const prefixes = counted ? [[1, ""]] : [[1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
    const [factor, prefix] = prefixes.find((one) => largest >= one[0] * whole) || prefixes[prefixes.length - 1];
    const scale = factor * whole;
    const unit = counted ? "" : ` [${prefix}${turn ? "°" : series.unit}]`;
    const options = { name: "residual-" + place, label: series.name + " over time", xName: "time [s]",
      yName: series.name + unit, yScale: scale, height: (w) => (w < 500 ? 190 : 210), hint: " ",
      view: () => ({ x: shown, y: bounds }) };
    function draw(plot) {
      line(plot.inside, series.t, series.value, plot.toX, plot.toY, COLOURS.before);
      if (series.explained) line(plot.inside, series.t, series.explained, plot.toX, plot.toY, COLOURS.after);
    }
    function moved(here) {
      crossAt(here.x);
      let best = 0;
      series.t.forEach((t, i) => { if (Math.abs(t - here.x) < Math.abs(series.t[best] - here.x)) best = i; });
      const left = series.explained ? `, left once explained ${written(series.explained[best], series.unit)}` : "";
      return `${series.t[best].toFixed(2)} s: ${written(series.value[best], series.unit)} as described${left}`;
    }
    timed.push(frame(host, options, draw, moved, dragTime, wholeTime));
  }

  function pathChart(host) {
    const visible = { reference: true, before: true, after: true };
    let current = data.path, zoomed = null, chart = null;
    const controls = html(host.parentNode, "div", "controls");
    host.before(controls);
    if (data.paths.length > 1) {
      const select = html(controls, "select");
      select.setAttribute("aria-label", "stretch");
      data.paths.forEach((one, i) => { html(select, "option", "", one.name).value = i; });
      select.value = current;
      select.addEventListener("change", () => { current = Number(select.value); zoomed = null; chart.paint(); });
    }
    for (const [key, name] of [["reference", "measured"], ["before", "as described"], ["after", "with what was found"]]) {
      if (!data.paths.some((one) => one[key])) continue;
      const button = html(controls, "button");
      html(button, "span", "swatch").style.background = COLOURS[key];
      button.append(name);
      button.setAttribute("aria-pressed", "true");
      button.addEventListener("click", () => {
        visible[key] = !visible[key];
        button.setAttribute("aria-pressed", String(visible[key]));
        chart.paint();
      });
    }
    const curves = () => ["reference", "before", "after"].filter((key) => data.paths[current][key]).map((key) => [key, data.paths[current][key]]);
    function view(area) {
      let [x, y] = zoomed || [extent(curves().map((c) => c[1][0])), extent(curves().map((c) => c[1][1]))];
      const scale = Math.max((x[1] - x[0]) / (area.right - area.left), (y[1] - y[0]) / (area.bottom - area.top));
      const around = ([a, b], size) => [(a + b) / 2 - scale * size / 2, (a + b) / 2 + scale * size / 2];
      return { x: around(x, area.right - area.left), y: around(y, area.bottom - area.top) };
    }
    const options = { name: "path", label: "Measured path, and simulated before and after", xName: "x [m]", yName: "y [m]", yScale: 1,
      bothWays: true, hint: "Drag a box to zoom in, double-click for all. One scale on both axes.", height: (w) => Math.min(520, Math.max(300, 0.7 * w)), view };
    chart = frame(host, options,
      (plot) => curves().forEach(([key, xy]) => {
        if (!visible[key]) return;
        line(plot.inside, xy[0], xy[1], plot.toX, plot.toY, COLOURS[key]);
        const end = xy[0].length - 1;
        if (end >= 0 && xy[0][end] !== null) element(plot.inside, "circle", { cx: plot.toX(xy[0][end]), cy: plot.toY(xy[1][end]), r: 4, style: "fill:" + COLOURS[key] });
      }),
      (here) => `x ${minus(here.x.toFixed(3))} m, y ${minus(here.y.toFixed(3))} m`,
      (a, b) => { zoomed = [[Math.min(a.x, b.x), Math.max(a.x, b.x)], [Math.min(a.y, b.y), Math.max(a.y, b.y)]]; chart.paint(); },
      () => { zoomed = null; chart.paint(); });
  }

  startTime();
  const host = (id) => document.getElementById(id);
  if (host("map")) mapChart(host("map"));
  data.residuals.forEach((series, place) => residualChart(host("residual-" + place), series, place));
  if (host("path")) pathChart(host("path"));
})();
