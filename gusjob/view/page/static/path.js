/* The path view: a map in mm with tiles that are drawn from the strokes. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const { element, figure, localized, short } = gusjob;
  const TILE = 256;
  const STEP = 4; // zoom levels for a factor of two
  const MAX_TURN_MS = 24; // drawing time before the page responds to events
  const REACH = 8; // px within which a click finds a stroke
  const calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  const U = gusjob.UNITS_PER_MM;

  const view = {
    show: { jumps: true, runs: true, switches: false, command: false }, by: "power", emissionNumber: 0, measure: null,
    bins: null, range: null, palette: null, ink: {},
  };

  /* Data for the tiles. */

  function extentOf(nodes, found) {
    for (let i = 0; i < nodes.x.length; i++) {
      if (nodes.x[i] < found[0]) found[0] = nodes.x[i];
      if (nodes.y[i] < found[1]) found[1] = nodes.y[i];
      if (nodes.x[i] > found[2]) found[2] = nodes.x[i];
      if (nodes.y[i] > found[3]) found[3] = nodes.y[i];
    }
    return found;
  }

  function indexOf(strokes) {
    const index = new window.Flatbush(strokes.count, 16, Int32Array);
    const { x, y } = strokes;
    const beam = strokes.beam || strokes;
    for (let i = 0; i < strokes.count; i++) {
      index.add(
        Math.min(x[i], x[i + 1], beam.x[i], beam.x[i + 1]), Math.min(y[i], y[i + 1], beam.y[i], beam.y[i + 1]),
        Math.max(x[i], x[i + 1], beam.x[i], beam.x[i + 1]), Math.max(y[i], y[i + 1], beam.y[i], beam.y[i + 1]),
      );
    }
    index.finish();
    return index;
  }

  function takeData() {
    const strokes = gusjob.strokes;
    view.strokes = strokes;
    view.kind = gusjob.rows.kind.values;
    view.kinds = gusjob.facts.kinds;
    view.emissions = gusjob.emissions;
    view.actual = strokes.beam || strokes; // Emission is drawn at the beam.
    view.index = indexOf(strokes);
    view.bounds = extentOf(strokes, [Infinity, Infinity, -Infinity, -Infinity]);
    if (strokes.beam) extentOf(strokes.beam, view.bounds);
  }

  function recolor() {
    const emission = view.emissions[view.emissionNumber] || null;
    Object.assign(view, gusjob.colors.binsOf(view.strokes, view.emissions, emission, view.by));
    retheme();
  }

  const rgbOf = (name) => (gusjob.colors.resolved(name).match(/[\d.]+/g) || [128, 128, 128]).slice(0, 3).map(Number);

  function retheme() {
    view.palette = gusjob.colors.palette(view.range && view.range.single);
    const names = { jump: "--path-jump", run_in: "--path-run-in", run_out: "--path-run-out",
      other: "--path-other", command: "--path-command", switches: "--path-switch" };
    for (const [key, name] of Object.entries(names)) view.ink[key] = rgbOf(name);
    drawLegend();
    if (view.layer) view.layer.redraw();
  }

  /* Tiles are drawn one after another, so that a large view does not block the page. */

  const waiting = [];
  let working = false;

  function work() {
    const until = performance.now() + MAX_TURN_MS;
    while (waiting.length && performance.now() < until) {
      const [canvas, coords, done] = waiting.shift();
      if (canvas.dataset.gone) continue;
      const map = view.map;
      gusjob.tiles.drawTile(view, canvas, coords, TILE, map.options.crs.scale(coords.z));
      done(null, canvas);
    }
    working = waiting.length > 0;
    if (working) setTimeout(work, 0);
  }

  function tileLayer() {
    const Layer = window.L.GridLayer.extend({
      createTile(coords, done) {
        const canvas = element("canvas", { class: "leaflet-tile" });
        canvas.width = canvas.height = Math.round(TILE * Math.min(window.devicePixelRatio || 1, 3));
        waiting.push([canvas, coords, done]);
        if (!working) {
          working = true;
          setTimeout(work, 0);
        }
        return canvas;
      },
    });
    const layer = new Layer({ tileSize: TILE, updateWhenZooming: false, keepBuffer: 1, noWrap: true });
    layer.on("tileunload", (event) => { event.tile.dataset.gone = "1"; });
    return layer;
  }

  /* The map. */

  function crs() {
    return window.L.extend({}, window.L.CRS.Simple, {
      scale: (zoom) => Math.pow(2, zoom / STEP),
      zoom: (scale) => (STEP * Math.log(scale)) / Math.LN2,
    });
  }

  const toLatLng = (nodes, i) => [nodes.y[i] / U, nodes.x[i] / U];
  function boundsMm(box) {
    const least = 0.01; // mm: the view of a path of one point
    const [x0, y0, x1, y1] = box;
    return [[y0 - least, x0 - least], [y1 + least, x1 + least]];
  }

  function wholePath() {
    const b = view.bounds.map((v) => v / U);
    view.map.fitBounds(boundsMm(b), { padding: [16, 16], animate: false });
  }

  function wholeField() {
    const { x, y } = gusjob.facts.field_mm;
    view.map.fitBounds(boundsMm([x[0], y[0], x[1], y[1]]), { padding: [8, 8], animate: false });
  }

  function makeMap(host) {
    const L = window.L;
    const map = L.map(host, {
      crs: crs(), minZoom: -16, maxZoom: 56, zoomSnap: 1, zoomDelta: 2, wheelPxPerZoomLevel: 30, attributionControl: false, zoomControl: false,
      zoomAnimation: !calm, fadeAnimation: false, markerZoomAnimation: !calm, inertia: !calm, maxBoundsViscosity: 0,
    });
    view.map = map;
    L.control.zoom({ zoomInTitle: localized("path", "zoom-in"), zoomOutTitle: localized("path", "zoom-out") }).addTo(map);
    const field = gusjob.facts.field_mm;
    wholePath();
    view.layer = tileLayer().addTo(map);
    if (field) {
      L.rectangle(boundsMm([field.x[0], field.y[0], field.x[1], field.y[1]]), { className: "field-limits", interactive: false, fill: false, noClip: true }).addTo(map);
    }
    map.on("zoomend moveend resize", drawScale);
    map.on("click", (event) => { const i = pick(event.latlng); if (i >= 0) gusjob.select(view.strokes.row[i], "path"); });
    hover(map, host);
    new ResizeObserver(() => map.invalidateSize({ animate: false })).observe(host);
    drawScale();
  }

  /* The stroke at a point: the nearest one; strokes with emission are preferred. */

  function distance(nodes, i, x, y) {
    const x0 = nodes.x[i], y0 = nodes.y[i];
    const dx = nodes.x[i + 1] - x0, dy = nodes.y[i + 1] - y0;
    const long = dx * dx + dy * dy;
    const share = long ? Math.max(0, Math.min(1, ((x - x0) * dx + (y - y0) * dy) / long)) : 0;
    return Math.hypot(x0 + share * dx - x, y0 + share * dy - y);
  }

  function pick(latlng) {
    const scale = view.map.options.crs.scale(view.map.getZoom());
    const reach = (REACH / scale) * U;
    const x = latlng.lng * U, y = latlng.lat * U;
    let best = -1, least = Infinity;
    for (const i of view.index.search(x - reach, y - reach, x + reach, y + reach)) {
      if (!gusjob.tiles.isShown(view, i)) continue;
      const d = distance(view.actual, i, x, y);
      const cost = d + (view.bins[i] ? 0 : reach / 2);
      if (d <= reach && (cost < least || (cost === least && i < best))) {
        best = i;
        least = cost;
      }
    }
    return best;
  }

  function perMmText(emission, i) {
    const value = view.strokes.values(`ch${emission.channel}_per_mm`)[i];
    return Number.isNaN(value) ? "" : ` (${short(value, 4)} ${gusjob.printable(emission.unit)}\u00b7ms/mm)`;
  }

  // Description of a stroke for the tooltips of both views.
  function describeStroke(i) {
    const { strokes } = view;
    const row = strokes.row[i];
    const v0 = figure(strokes.vel0[i], 4), v1 = figure(strokes.vel1[i], 4);
    const velocity = v0 === v1 ? v0 : localized("path", "from-to", { low: v0, high: v1 });
    const emitted = gusjob.emissions.filter((emission) => gusjob.isEmitting(emission, i))
      .map((emission) => `ch${emission.channel} ${figure(emission.power[i], 4)} ${gusjob.printable(emission.unit)}${perMmText(emission, i)}`);
    const emission = emitted.length && emitted.reduce((first, second) => localized("data", "and", { first, second }));
    return [
      localized("path", "place", { place: gusjob.placeOf(row), kind: gusjob.kindWord(gusjob.kindOf(row)), segment: row + 1 }),
      emission ? localized("path", "on", { velocity, emission }) : localized("path", "off", { velocity }),
    ];
  }

  function hover(map, host) {
    const tip = window.L.tooltip({ direction: "top", offset: [0, -6], opacity: 1, className: "tip" });
    let last = null, scheduled = false;
    const look = () => {
      scheduled = false;
      const i = last ? pick(last) : -1;
      host.classList.toggle("over-stroke", i >= 0);
      if (i < 0) return void map.closeTooltip(tip);
      const [first, second] = describeStroke(i);
      tip.setContent(element("div", {}, element("b", {}, first), element("br"), second)).setLatLng(last);
      map.openTooltip(tip);
    };
    const ask = (latlng) => {
      last = latlng;
      if (!scheduled) requestAnimationFrame(look);
      scheduled = true;
    };
    map.on("mousemove", (event) => ask(event.latlng));
    map.on("mouseout movestart zoomstart", () => ask(null));
  }

  /* Selection. */

  const MOST_POINTS = 4000;

  function pointsOf(row) {
    const { strokes, actual } = view;
    const from = strokes.first[row], to = strokes.first[row + 1];
    const step = Math.max(1, Math.ceil((to - from) / MOST_POINTS));
    const points = [];
    for (let i = from; i < to; i += step) points.push(toLatLng(actual, i));
    points.push(toLatLng(actual, to));
    return points;
  }

  function show(row) {
    const L = window.L;
    if (view.chosen) view.chosen.remove();
    view.chosen = null;
    if (row === null) return;
    const points = pointsOf(row);
    const quiet = { interactive: false, fill: false, noClip: false, smoothFactor: 0.5 };
    const end = (at, name) => L.circleMarker(at, { radius: 5, interactive: false, className: name });
    view.chosen = L.featureGroup([
      L.polyline(points, { ...quiet, className: "chosen-casing" }), L.polyline(points, { ...quiet, className: "chosen-line" }),
      end(points[0], "chosen-start"), end(points[points.length - 1], "chosen-end"),
    ]).addTo(view.map);
    const box = L.latLngBounds(points);
    // The map does not move if any part of the segment's box is visible.
    if (!view.map.getBounds().intersects(box)) view.map.panTo(box.getCenter(), { animate: !calm });
  }

  /* Legend and scale bar, both as text too. */

  function drawLegend() {
    const bar = document.getElementById("legend-bar");
    if (!bar || !view.palette) return;
    const { range, measure, palette } = view;
    const { css } = gusjob.colors;
    const stops = palette.slice(1, -1).filter((_, n, all) => n % 9 === 0 || n === all.length - 1).map(css);
    bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    bar.hidden = !range;
    const emission = view.emissions && view.emissions[view.emissionNumber];
    const [k, unit] = measure ? unitOf(measure) : [1, ""];
    const tell = (id, text) => {
      const node = document.getElementById(id);
      node.textContent = text;
      node.closest(".beyond, .number").hidden = !text;
    };
    const ofChannel = emission && view.emissions.length > 1 && (view.by === "power" || view.by === "energy");
    const about = range && { what: measure.word, unit: gusjob.printable(unit), channel: emission.channel };
    document.getElementById("legend-name").textContent =
      range ? localized("path", ofChannel ? "legend-channel" : "legend", about) : localized("path", "no-emission");
    const text = (value) => figure(value * k, 4), whole = (value) => short(value * k, 4);
    tell("legend-low", range && !range.single ? text(range.low) : "");
    tell("legend-high", range ? (range.least === range.most ? localized("path", "everywhere", { value: text(range.high) }) : text(range.high)) : "");
    const under = range && range.least < range.low, over = range && range.most > range.high;
    tell("legend-under", under ? localized("path", "under", { value: text(range.low), least: whole(range.least) }) : "");
    tell("legend-over", over ? localized("path", "over", { value: text(range.high), most: whole(range.most) }) : "");
  }

  // Factor and unit of a quantity: times above a second are in s.
  function unitOf(measure) {
    return measure.unit === "ms" && view.range && view.range.most >= 1000 ? [1e-3, "s"] : [1, measure.unit];
  }

  function drawScale() {
    const map = view.map, bar = document.getElementById("scale-bar");
    const perMm = map.options.crs.scale(map.getZoom());
    const target = 110 / perMm;
    const ten = Math.pow(10, Math.floor(Math.log10(target)));
    const mm = [5, 2, 1].map((n) => n * ten).find((n) => n <= target);
    bar.style.width = `${mm * perMm}px`;
    bar.textContent = mm >= 0.1 ? `${figure(mm)} mm` : mm >= 1e-4 ? `${figure(mm * 1e3)} um` : `${figure(mm * 1e6)} nm`;
  }

  /* Controls. */

  function toggles() {
    const bind = (id, name, there) => {
      const box = document.getElementById(id);
      box.closest("label").hidden = !there;
      box.checked = view.show[name];
      box.addEventListener("change", () => { view.show[name] = box.checked; keys(); view.layer.redraw(); keep(); });
    };
    const has = (...words) => { // whether there are segments of these kinds
      const numbers = words.map((word) => view.kinds.indexOf(word));
      return view.kind.some((k) => numbers.includes(k));
    };
    bind("show-jumps", "jumps", true);
    bind("show-runs", "runs", has("run_in", "run_out"));
    bind("show-switches", "switches", view.emissions.length > 0);
    bind("show-command", "command", !!view.strokes.beam);
    keys();
  }

  // The legend names only what is drawn.
  function keys() {
    const has = (word) => view.kind.includes(view.kinds.indexOf(word));
    const { jumps, runs, switches, command } = view.show;
    const several = new Set(view.emissions.map((emission) => emission.channel)).size > 1;
    const shown = {
      jump: jumps, "run-in": runs && has("run_in"), "run-out": runs && has("run_out"), command: command && !!view.strokes.beam,
      other: several, switches,
    };
    for (const [name, there] of Object.entries(shown)) document.getElementById(`key-${name}`).hidden = !there;
  }

  function selects() {
    const by = document.getElementById("color-by"), channel = document.getElementById("color-channel");
    view.emissions.forEach((emission, n) => channel.append(element("option", { value: n }, localized("path", "channel", { channel: emission.channel, unit: gusjob.printable(emission.unit) }))));
    channel.closest("label").hidden = view.emissions.length < 2;
    by.closest("label").hidden = !view.emissions.length;
    const changed = () => {
      view.by = by.value;
      view.emissionNumber = Number(channel.value || 0);
      recolor();
      keep();
    };
    by.addEventListener("change", changed);
    channel.addEventListener("change", changed);
  }

  async function start() {
    takeData();
    await gusjob.yieldToBrowser();
    view.widths = gusjob.tiles.spacingOf(view);
    recolor();
    toggles();
    makeMap(document.getElementById("map"));
    selects();
    document.getElementById("fit-path").addEventListener("click", wholePath);
    const fit = document.getElementById("fit-field");
    fit.hidden = !gusjob.facts.field_mm;
    fit.addEventListener("click", wholeField);
    chooseAgain();
  }

  function state() {
    const at = view.map.getCenter();
    return { at: [at.lat, at.lng], zoom: view.map.getZoom(), ...choices() };
  }

  function restore(kept) {
    view.map.setView(kept.at, kept.zoom, { animate: false });
    choose(kept);
  }

  // What is shown and how it is colored stays when the page is loaded again.
  const KEPT = `gusjob-path:${location.pathname}`;
  const choices = () => ({ show: view.show, by: view.by, emission: view.emissionNumber });
  const keep = () => gusjob.kept(() => window.sessionStorage, KEPT, JSON.stringify(choices()));

  function choose(kept) {
    const set = (id, value) => {
      const node = document.getElementById(id);
      if (node.type === "checkbox") node.checked = value;
      else node.value = value;
      node.dispatchEvent(new Event("change"));
    };
    for (const [id, name] of [["show-jumps", "jumps"], ["show-runs", "runs"], ["show-switches", "switches"], ["show-command", "command"]]) set(id, kept.show[name]);
    set("color-by", kept.by);
    if (kept.emission < view.emissions.length) set("color-channel", String(kept.emission));
  }

  function chooseAgain() {
    try {
      const text = gusjob.kept(() => window.sessionStorage, KEPT);
      if (text) choose(JSON.parse(text));
    } catch (_) { /* The choices are of another version of the page: start with the defaults. */ }
  }

  gusjob.path = { start, show, retheme, describeStroke, state, restore, view, pick, isIdle: () => !working };
})();
