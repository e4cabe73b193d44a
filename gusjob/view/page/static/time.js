/* The time view: velocity, power and laser on/off over time; each stroke, or minimum and maximum per pixel of many. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const { element, figure, localized } = gusjob;
  const FEW = 4000;
  const BAND = 9; // px: height of the on/off band
  const WHEEL = 1.25;
  const CLICK = 4; // px: movement that still counts as a click
  const view = { plot: null, from: 0, to: 1, end: 1, bands: [], colors: {} };

  // Factor and unit of times: s if the run takes longer than a second.
  const scaleOf = () => (view.end >= 1000 ? [1e-3, "s"] : [1, "ms"]);

  // A time with four digits of the span in which it is seen.
  function timeText(ms, spanMs) {
    const [k] = scaleOf();
    const after = clamp(3 - Math.floor(Math.log10(spanMs * k)), 0, 9);
    return String(Number((ms * k).toFixed(after)));
  }

  const clamp = (v, low, high) => Math.max(low, Math.min(high, v));

  // Last stroke that starts at a time or before it.
  function strokeAt(time) {
    const { start, count } = gusjob.strokes;
    let low = 0, high = count - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (start[middle] <= time) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  const powerOf = (emission, i) => (gusjob.isEmitting(emission, i) ? emission.power[i] : 0);

  function exact(first, last) {
    const { start, vel0, vel1 } = gusjob.strokes;
    const data = [[], [], ...gusjob.emissions.map(() => [])];
    for (let i = first; i <= last; i++) {
      data[0].push(start[i], start[i + 1]);
      data[1].push(vel0[i], vel1[i]);
      gusjob.emissions.forEach((emission, n) => { const p = powerOf(emission, i); data[2 + n].push(p, p); });
    }
    return data;
  }

  function widen(low, high, c, a, b) {
    if (a > b) [a, b] = [b, a];
    if (a < low[c]) low[c] = a;
    if (b > high[c]) high[c] = b;
  }

  // Minimum and maximum of each pixel column; a stroke may cover several columns.
  function spread(first, last, width, at0, at1) {
    const { start } = gusjob.strokes;
    const low = new Float64Array(width).fill(Infinity), high = new Float64Array(width).fill(-Infinity);
    const k = width / (view.to - view.from);
    for (let i = first; i <= last; i++) {
      const from = start[i], to = start[i + 1];
      const a = clamp(Math.floor((from - view.from) * k), 0, width - 1);
      const b = clamp(Math.floor((to - view.from) * k), 0, width - 1);
      const v0 = at0(i), v1 = at1(i);
      if (a === b) widen(low, high, a, v0, v1);
      else {
        const slope = (v1 - v0) / (to - from);
        for (let c = a; c <= b; c++) {
          const t0 = Math.max(from, view.from + c / k), t1 = Math.min(to, view.from + (c + 1) / k);
          widen(low, high, c, v0 + slope * (t0 - from), v0 + slope * (t1 - from));
        }
      }
    }
    return [low, high];
  }

  function envelope(first, last, width) {
    const { vel0, vel1 } = gusjob.strokes;
    const spreads = [spread(first, last, width, (i) => vel0[i], (i) => vel1[i])];
    for (const emission of gusjob.emissions) spreads.push(spread(first, last, width, (i) => powerOf(emission, i), (i) => powerOf(emission, i)));
    const data = [[], ...spreads.map(() => [])];
    for (let c = 0; c < width; c++) {
      if (spreads[0][0][c] === Infinity) continue;
      const time = view.from + ((c + 0.5) / width) * (view.to - view.from);
      data[0].push(time, time);
      spreads.forEach(([low, high], n) => data[1 + n].push(low[c], high[c]));
    }
    return data;
  }

  // Share of each pixel column in which a channel is on.
  function bandOf(on, first, last, width) {
    const { start } = gusjob.strokes;
    const share = new Float32Array(width);
    const k = width / (view.to - view.from);
    for (let i = first; i <= last; i++) {
      if (!on[i]) continue;
      const a = Math.max(0, (start[i] - view.from) * k), b = Math.min(width, (start[i + 1] - view.from) * k);
      for (let c = Math.floor(a); c < b; c++) share[c] += Math.min(b, c + 1) - Math.max(a, c);
    }
    return share;
  }

  let refreshing = false;

  function refresh() {
    const plot = view.plot;
    const first = strokeAt(view.from), last = strokeAt(view.to);
    const width = Math.max(1, Math.round(plot.over.clientWidth || plot.bbox.width / window.devicePixelRatio));
    const data = last - first < FEW ? exact(first, last) : envelope(first, last, width);
    view.bands = channels().map((emission) => bandOf(emission.on, first, last, width));
    refreshing = true;
    plot.batch(() => {
      plot.setData(data, false);
      plot.setScale("x", { min: view.from, max: view.to });
    });
    refreshing = false;
    placeMarker();
    const [span, unit] = [view.to - view.from, scaleOf()[1]];
    const range = { low: timeText(view.from, span), high: timeText(view.to, span), end: timeText(view.end, view.end), unit };
    document.getElementById("time-range").textContent = localized("time", "range", range);
  }

  let scheduled = false;
  function zoomTo(from, to) {
    const least = Math.max(view.end * 1e-9, 1e-5);
    const long = clamp(to - from, least, view.end);
    view.from = clamp(from, 0, view.end - long);
    view.to = view.from + long;
    if (scheduled) return;
    scheduled = true;
    requestAnimationFrame(() => { scheduled = false; refresh(); });
  }

  const reset = () => zoomTo(0, view.end);
  const zoomBy = (factor, around = (view.from + view.to) / 2) =>
    zoomTo(around - (around - view.from) * factor, around + (view.to - around) * factor);
  const panBy = (share) => {
    const step = (view.to - view.from) * share;
    zoomTo(view.from + step, view.to + step);
  };

  /* The plot. */

  // One emission per channel: on/off does not depend on the unit.
  const channels = () => gusjob.emissions.filter((emission) => emission.index === 0);

  // From bottom to top: on/off bands, power, velocity.
  const bandShare = () => 0.03 + (channels().length * (BAND + 3)) / 215;
  const lanes = () => (gusjob.emissions.length ? { power: [bandShare(), 0.5], velocity: [0.56, 0.98] } : { velocity: [0.03, 0.97] });

  // The scale on which 0 to `highest` fill a lane; a lane is a range of the plot's height.
  function rangeOf([low, high], highest) {
    const whole = highest / (high - low);
    return () => [-low * whole, (1 - low) * whole];
  }

  const most = (values) => values.reduce((a, b) => (b > a ? b : a), 0) || 1;
  const FONT = "12px system-ui, sans-serif";

  function axis(scale, label, color, highest, rest) {
    const filter = (_, splits) => splits.map((v) => (v >= 0 && v <= highest * 1.001 ? v : null));
    const line = { stroke: () => view.colors.grid, width: 1, filter };
    const narrow = window.innerWidth < 560; // Then only the key names the units.
    return {
      scale, label: narrow && scale !== "x" ? undefined : label, labelFont: FONT, font: FONT, labelSize: 18, size: narrow ? 48 : 52,
      stroke: () => view.colors[color], grid: line, ticks: line, space: scale === "x" ? 60 : 24, filter,
      values: (_, splits) => splits.map((v) => (v === null ? "" : scale === "x" ? timeText(v, view.to - view.from) : figure(v, 4))), ...rest,
    };
  }

  function optionsOf(width, height) {
    const { strokes, emissions } = gusjob;
    const units = [...new Set(emissions.map((emission) => emission.unit))];
    const fastest = Math.max(most(strokes.vel0), most(strokes.vel1));
    const scales = { x: { time: false, auto: false }, v: { auto: false, range: rangeOf(lanes().velocity, fastest) } };
    const axes = [axis("x", scaleOf()[1], "ink", Infinity, { size: 34 }), axis("v", "mm/s", "velocity", fastest)];
    units.forEach((unit, n) => {
      const highest = Math.max(...emissions.filter((emission) => emission.unit === unit).map((emission) => most(emission.power)));
      scales[`p${n}`] = { auto: false, range: rangeOf(lanes().power, highest) };
      axes.push(axis(`p${n}`, gusjob.printable(unit), `power${n % 2}`, highest, n ? { side: 1, grid: { show: false } } : { side: 1 }));
    });
    const series = [{}, { scale: "v", stroke: () => view.colors.velocity, width: 1.2, points: { show: false } }];
    emissions.forEach((emission, n) => series.push({
      scale: `p${units.indexOf(emission.unit)}`, stroke: () => view.colors[`power${n % 2}`], width: 1.4, points: { show: false },
      dash: n % 2 ? [6, 3] : undefined,
    }));
    return {
      width, height, scales, axes, series, legend: { show: false }, padding: [8, emissions.length ? 0 : 12, 0, 0],
      cursor: { y: false, points: { show: false }, drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => { reset(); return null; } } },
      hooks: { draw: [drawBands], setSelect: [zoomToSelect], setCursor: [hover] },
    };
  }

  function zoomToSelect(plot) {
    const { left, width } = plot.select;
    if (width > CLICK && !refreshing) {
      const from = plot.posToVal(left, "x"), to = plot.posToVal(left + width, "x");
      plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      zoomTo(from, to);
    }
  }

  function drawBands(plot) {
    const { ctx, bbox } = plot;
    const ratio = window.devicePixelRatio || 1;
    ctx.save();
    channels().forEach((emission, n) => {
      const top = bbox.top + bbox.height - (BAND + 3) * ratio * (n + 1);
      const share = view.bands[n] || [];
      const column = bbox.width / Math.max(1, share.length);
      ctx.fillStyle = view.colors[`power${n % 2}`];
      for (let c = 0; c < share.length; c++) {
        if (!share[c]) continue;
        ctx.globalAlpha = 0.25 + 0.75 * Math.min(1, share[c]);
        ctx.fillRect(bbox.left + c * column, top, Math.ceil(column), BAND * ratio);
      }
      ctx.globalAlpha = 1;
      ctx.fillStyle = view.colors.ink;
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      ctx.textAlign = "right";
      ctx.textBaseline = "middle";
      ctx.fillText(localized("time", "switch", { channel: emission.channel }), bbox.left - 4 * ratio, top + (BAND / 2) * ratio);
    });
    ctx.restore();
  }

  function hover(plot) {
    const out = document.getElementById("time-hover");
    const { left } = plot.cursor;
    if (left === undefined || left < 0) {
      out.textContent = "";
      return;
    }
    const time = plot.posToVal(left, "x");
    out.textContent = `${timeText(time, view.to - view.from)} ${scaleOf()[1]} \u2014 ${gusjob.path.describeStroke(strokeAt(time)).join(" \u2014 ")}`;
  }

  /* Selection: a band over the plot with a minimum width. */

  const spanOf = (row) => [gusjob.rows.starts[row], gusjob.rows.starts[row + 1]];

  function placeMarker() {
    const marker = view.marker, row = gusjob.selected;
    marker.hidden = row === null;
    if (row === null) return;
    const plot = view.plot;
    const [from, to] = spanOf(row);
    marker.hidden = to < view.from || from > view.to;
    const left = clamp(plot.valToPos(from, "x"), -10, plot.over.clientWidth + 10);
    const right = clamp(plot.valToPos(to, "x"), -10, plot.over.clientWidth + 10);
    marker.style.left = `${left}px`;
    marker.style.width = `${Math.max(2, right - left)}px`;
    marker.dataset.row = row;
  }

  function show(row) {
    if (row !== null) {
      const [from, to] = spanOf(row);
      if (to < view.from || from > view.to) {
        const long = view.to - view.from;
        return zoomTo((from + to) / 2 - long / 2, (from + to) / 2 + long / 2);
      }
    }
    placeMarker();
  }

  function selectAt(time) {
    gusjob.select(gusjob.strokes.row[strokeAt(time)], "time");
  }

  function pointer(over) {
    let down = null;
    over.addEventListener("mousedown", (event) => { down = [event.clientX, event.clientY]; });
    over.addEventListener("click", (event) => {
      if (down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) > CLICK) return;
      selectAt(view.plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x"));
    });
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const at = view.plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) panBy(event.deltaX / 800);
      else zoomBy(event.deltaY > 0 ? WHEEL : 1 / WHEEL, at);
    }, { passive: false });
  }

  const KEYS = {
    ArrowLeft: () => panBy(-0.2), ArrowRight: () => panBy(0.2), "+": () => zoomBy(0.5), "=": () => zoomBy(0.5), "-": () => zoomBy(2),
    Home: reset, 0: reset, Enter: () => selectAt((view.from + view.to) / 2),
  };

  function controls(host) {
    host.addEventListener("keydown", (event) => {
      const act = !event.ctrlKey && !event.altKey && !event.metaKey && KEYS[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });
    const on = (id, act) => document.getElementById(id).addEventListener("click", act);
    on("time-in", () => zoomBy(0.5));
    on("time-out", () => zoomBy(2));
    on("time-left", () => panBy(-0.4));
    on("time-right", () => panBy(0.4));
    on("time-all", reset);
    on("time-chosen", () => {
      if (gusjob.selected === null) return;
      const [from, to] = spanOf(gusjob.selected);
      const room = Math.max((to - from) * 2, 1e-3);
      zoomTo(from - room, to + room);
    });
  }

  // The key of the curves: color, dashes of the second one, and text.
  function drawKey() {
    const key = document.getElementById("time-key");
    const entry = (color, dashed, words) => {
      const line = element("i", { class: dashed ? "swatch dashed" : "swatch" });
      line.style.borderColor = `var(--${color})`;
      return element("span", {}, line, words);
    };
    key.replaceChildren(entry("velocity", false, localized("time", "velocity")), ...gusjob.emissions.map((emission, n) =>
      entry(`power${n % 2}`, n % 2 === 1, localized("time", "power", { channel: emission.channel, unit: gusjob.printable(emission.unit) }))));
  }

  function takeColors() {
    for (const name of ["ink", "grid", "velocity", "power0", "power1"]) view.colors[name] = gusjob.colors.resolved(`--${name}`);
  }

  function retheme() {
    takeColors();
    if (view.plot) view.plot.redraw(false, true);
  }

  function start() {
    const host = document.getElementById("time");
    view.end = gusjob.strokes.start[gusjob.strokes.count] || 1;
    view.to = view.end;
    takeColors();
    drawKey();
    view.plot = new window.uPlot(optionsOf(host.clientWidth, host.clientHeight), [[], [], ...gusjob.emissions.map(() => [])], host);
    view.marker = element("div", { class: "time-marker", hidden: "" });
    view.plot.over.append(view.marker);
    pointer(view.plot.over);
    controls(host);
    new ResizeObserver(() => {
      if (host.clientWidth === view.plot.width && host.clientHeight === view.plot.height) return;
      view.plot.setSize({ width: host.clientWidth, height: host.clientHeight });
      refresh();
    }).observe(host);
    refresh();
  }

  gusjob.time = { start, show, retheme, zoomTo, view, state: () => ({ from: view.from, to: view.to }), restore: (k) => zoomTo(k.from, k.to) };
})();
