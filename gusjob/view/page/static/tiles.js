/* A tile of the path view: few strokes as canvas lines, many as pixels, which is about a hundred times faster. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const FEW = 8000; // strokes per tile that a canvas draws in about 20 ms
  const PAD = 10; // px: margin for line widths and switch points of neighbouring tiles
  const DASHES = { jump: [5, 4], run_in: [2, 2], run_out: [8, 2, 2, 2] };
  const SWITCHES = 3000; // more would hide the path

  // Part of a line that is inside of a box; null: none (Liang and Barsky).
  function clipped(x0, y0, x1, y1, low, highX, highY) {
    let from = 0, to = 1;
    const dx = x1 - x0, dy = y1 - y0;
    for (const [step, room] of [[-dx, x0 - low], [dx, highX - x0], [-dy, y0 - low], [dy, highY - y0]]) {
      if (step === 0) {
        if (room < 0) return null;
      } else if (step < 0) from = Math.max(from, room / step);
      else to = Math.min(to, room / step);
    }
    return from > to ? null : [x0 + from * dx, y0 + from * dy, x0 + to * dx, y0 + to * dy];
  }

  // Geometry of one tile: units to its own pixels.
  function frameOf(coords, size, scale, ratio) {
    const k = (scale * ratio) / gusjob.UNITS_PER_MM;
    const ox = coords.x * size * ratio, oy = coords.y * size * ratio;
    const pad = PAD * ratio, side = size * ratio;
    return {
      side, ratio, k,
      x: (units) => units * k - ox, y: (units) => -units * k - oy, ox, oy,
      box: [(ox - pad) / k, (-oy - side - pad) / k, (ox + side + pad) / k, (-oy + pad) / k],
    };
  }

  function idsIn(view, frame) {
    const [x0, y0, x1, y1] = frame.box;
    const all = view.bounds;
    if (x0 <= all[0] && y0 <= all[1] && x1 >= all[2] && y1 >= all[3]) return null; // All strokes: no search is necessary.
    return view.index.search(x0, y0, x1, y1);
  }

  // How a stroke without emission is drawn: run-ins and run-outs in their own ways, all others as jumps.
  function offKind(view, i) {
    const kind = view.kinds[view.kind[view.strokes.row[i]]];
    return kind === "run_in" || kind === "run_out" ? kind : "jump";
  }

  function isShown(view, i) {
    if (view.bins[i]) return true;
    return offKind(view, i) === "jump" ? view.show.jumps : view.show.runs;
  }

  /* Widths: hatch lines must not merge into an area. */

  const CELLS = 64;
  const WIDEST = 2.2, THINNEST = 0.6; // px
  const WIDTHS = [0.6, 0.7, 0.85, 1, 1.2, 1.45, 1.8, 2.2];
  const MOST_SAMPLES = 256; // of a stroke

  // Distance between the strokes with emission around each stroke, in units: the area of a cell by the length in it.
  function spacingOf(view) {
    const { actual, strokes, emissions } = view;
    const [x0, y0, x1, y1] = view.bounds;
    const side = Math.max(x1 - x0, y1 - y0, 1) / CELLS;
    const lengths = new Float64Array((CELLS + 1) * (CELLS + 1));
    const cellAt = (x, y) => Math.floor((y - y0) / side) * (CELLS + 1) + Math.floor((x - x0) / side);
    for (let i = 0; i < strokes.count; i++) {
      if (!emissions.some((emission) => gusjob.isEmitting(emission, i))) continue;
      const dx = actual.x[i + 1] - actual.x[i], dy = actual.y[i + 1] - actual.y[i];
      const long = Math.hypot(dx, dy);
      const samples = Math.min(MOST_SAMPLES, Math.ceil((2 * long) / side));
      for (let n = 0; n < samples; n++) {
        const share = (n + 0.5) / samples;
        lengths[cellAt(actual.x[i] + dx * share, actual.y[i] + dy * share)] += long / samples;
      }
    }
    const spacing = new Float32Array(strokes.count);
    const around = blurred(lengths);
    for (let i = 0; i < strokes.count; i++) {
      const cell = cellAt((actual.x[i] + actual.x[i + 1]) / 2, (actual.y[i] + actual.y[i + 1]) / 2);
      spacing[i] = (side * side) / Math.max(around[cell], side / 16);
    }
    return spacing;
  }

  // Mean of each cell and its neighbours with emission: a single cell holds one line of a hatch or two by chance.
  function blurred(lengths) {
    const wide = CELLS + 1;
    return lengths.map((_, cell) => {
      let sum = 0, count = 0;
      for (let dy = -1; dy <= 1; dy++) {
        for (let dx = -1; dx <= 1; dx++) {
          const column = (cell % wide) + dx, value = lengths[cell + dy * wide + dx];
          if (column < 0 || column >= wide || !value) continue;
          sum += value;
          count++;
        }
      }
      return count ? sum / count : 0;
    });
  }

  // Number of a stroke's width: half the distance of its neighbours; if pixels can't show that, they touch.
  function widthOf(view, frame, i) {
    const px = (view.widths[i] * frame.k) / frame.ratio;
    const width = Math.min(Math.max(px / 2, Math.min(1.5 * px, THINNEST)), WIDEST);
    let number = WIDTHS.length - 1;
    while (number > 0 && WIDTHS[number] > width * 1.05) number--;
    return number;
  }

  /* As pixels: each has the highest level of the strokes over it, so that the highest value is never hidden. */

  const THICK = 30000; // tiles with fewer strokes are drawn two pixels wide

  function raise(levels, at, level) {
    if (levels[at] < level) levels[at] = level;
  }

  function markLine(levels, side, level, line, thick) {
    const x0 = line[0], y0 = line[1];
    const dx = line[2] - x0, dy = line[3] - y0;
    const steps = Math.max(1, Math.ceil(Math.max(Math.abs(dx), Math.abs(dy))));
    const sx = dx / steps, sy = dy / steps;
    for (let n = 0, x = x0, y = y0; n <= steps; n++, x += sx, y += sy) {
      const px = Math.floor(x), py = Math.floor(y);
      if (px < 0 || py < 0 || px >= side || py >= side) continue;
      const at = py * side + px;
      raise(levels, at, level);
      if (!thick) continue;
      if (px + 1 < side) raise(levels, at + 1, level);
      if (py + 1 < side) raise(levels, at + side, level);
    }
  }

  const LEVELS = { command: 1, jump: 2, run_in: 3, run_out: 4, other: 5, emission: 6 };

  function levelsOf(view, frame, ids, count) {
    const { strokes, bins, actual } = view;
    const levels = new Uint8Array(frame.side * frame.side);
    const side = frame.side;
    const thick = frame.usual < THICK || frame.ratio >= 1.5;
    const wide = (i) => frame.ratio >= 1.5 || WIDTHS[widthOf(view, frame, i)] >= 1.5;
    const plot = (nodes, i, level) => {
      const line = clipped(frame.x(nodes.x[i]), frame.y(nodes.y[i]), frame.x(nodes.x[i + 1]), frame.y(nodes.y[i + 1]), -1, side, side);
      if (line) markLine(levels, side, level, line, thick && level >= LEVELS.emission && wide(i));
    };
    const command = view.show.command && strokes.beam;
    for (let n = 0; n < count; n++) {
      const i = ids ? ids[n] : n;
      if (command) plot(strokes, i, LEVELS.command);
      const bin = bins[i];
      if (!bin && !isShown(view, i)) continue;
      plot(actual, i, bin === 255 ? LEVELS.other : bin ? LEVELS.emission + bin - 1 : LEVELS[offKind(view, i)]);
    }
    return levels;
  }

  function drawPixels(view, frame, context, ids, count) {
    const levels = levelsOf(view, frame, ids, count);
    const colors = new Uint32Array(256);
    const pack = (rgb, alpha) => ((alpha << 24) | (rgb[2] << 16) | (rgb[1] << 8) | rgb[0]) >>> 0;
    for (const [name, level] of Object.entries(LEVELS)) if (name !== "emission") colors[level] = pack(view.ink[name], name === "jump" ? 120 : 200);
    view.palette.forEach((rgb, bin) => { colors[LEVELS.emission + bin] = pack(rgb, 255); });
    const image = context.createImageData(frame.side, frame.side);
    const out = new Uint32Array(image.data.buffer);
    for (let i = 0; i < out.length; i++) out[i] = colors[levels[i]];
    context.putImageData(image, 0, 0);
  }

  /* As lines. */

  function addLine(frame, context, nodes, i, reach) {
    const line = [frame.x(nodes.x[i]), frame.y(nodes.y[i]), frame.x(nodes.x[i + 1]), frame.y(nodes.y[i + 1])];
    // Canvas loses precision far outside; near lines are not clipped, so that dashes continue from tile to tile.
    const near = line.every((v) => Math.abs(v) < reach);
    const part = near ? line : clipped(...line, -2 * PAD * frame.ratio, frame.side + 2 * PAD * frame.ratio, frame.side + 2 * PAD * frame.ratio);
    if (!part) return;
    context.moveTo(part[0], part[1]);
    context.lineTo(part[2], part[3]);
  }

  function strokeGroup(frame, context, nodes, ids, style) {
    if (!ids.length) return;
    context.beginPath();
    for (const i of ids) addLine(frame, context, nodes, i, 30000);
    context.lineWidth = style.width * frame.ratio;
    context.strokeStyle = style.color;
    context.setLineDash((style.dash || []).map((v) => v * frame.ratio));
    context.stroke();
    context.setLineDash([]);
  }

  function dot(frame, context, nodes, i, radius, color) {
    context.beginPath();
    context.arc(frame.x(nodes.x[i]), frame.y(nodes.y[i]), radius * frame.ratio, 0, 7);
    context.fillStyle = color;
    context.fill();
  }

  // Strokes of one look: those without emission by kind, the others by color and width.
  function grouped(view, frame, ids) {
    const groups = new Map();
    for (const i of ids) {
      const bin = view.bins[i];
      if (!bin && !isShown(view, i)) continue;
      const key = bin ? bin * WIDTHS.length + widthOf(view, frame, i) : offKind(view, i);
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(i);
    }
    return groups;
  }

  function drawLines(view, frame, context, ids) {
    const css = gusjob.colors.css;
    const groups = grouped(view, frame, ids);
    context.lineCap = "butt";
    for (const kind of ["jump", "run_in", "run_out"]) {
      strokeGroup(frame, context, view.actual, groups.get(kind) || [], { width: 1, color: css(view.ink[kind]), dash: DASHES[kind] });
    }
    context.lineCap = "round";
    const still = (i) => view.actual.x[i] === view.actual.x[i + 1] && view.actual.y[i] === view.actual.y[i + 1];
    // The highest value is drawn last.
    for (const bin of [255, ...view.palette.keys()].map((place, n) => (n ? place + 1 : place))) {
      const color = css(bin === 255 ? view.ink.other : view.palette[bin - 1]);
      const outside = bin === 1 || bin === view.palette.length; // Short, since they are few: wider.
      WIDTHS.forEach((width, number) => {
        const some = groups.get(bin * WIDTHS.length + number);
        if (!some) return;
        strokeGroup(frame, context, view.actual, some, { width: outside ? 1.5 * width : width, color });
        for (const i of some) if (bin !== 255 && still(i)) dot(frame, context, view.actual, i, Math.max(1, 1.4 * width), color);
      });
    }
    if (view.show.command && view.strokes.beam) {
      strokeGroup(frame, context, view.strokes, ids, { width: 1, color: css(view.ink.command) });
    }
  }

  /* Switch points: a circle where emission begins, a cross where it ends. */

  function switchesOf(view, ids, count) {
    const found = [];
    for (let n = 0; n < count; n++) {
      const i = ids ? ids[n] : n;
      for (const emission of view.emissions) {
        const now = gusjob.isEmitting(emission, i), before = i > 0 && gusjob.isEmitting(emission, i - 1);
        if (now !== before) found.push([i, now]);
        if (now && i === view.strokes.count - 1) found.push([i + 1, false]);
      }
      if (found.length > SWITCHES) return [];
    }
    return found;
  }

  function drawSwitches(view, frame, context, ids, count) {
    context.strokeStyle = gusjob.colors.css(view.ink.switches);
    context.lineWidth = 1.4 * frame.ratio;
    const r = 4 * frame.ratio;
    context.beginPath();
    for (const [node, on] of switchesOf(view, ids, count)) {
      const x = frame.x(view.actual.x[node]), y = frame.y(view.actual.y[node]);
      if (on) {
        context.moveTo(x + r, y);
        context.arc(x, y, r, 0, 2 * Math.PI);
      } else {
        context.moveTo(x - r, y - r);
        context.lineTo(x + r, y + r);
        context.moveTo(x - r, y + r);
        context.lineTo(x + r, y - r);
      }
    }
    context.stroke();
  }

  // Strokes in a usual tile at a scale. All tiles are drawn alike by it: a change of style would look like a change of the path.
  function usualCount(view, size, scale) {
    const [x0, y0, x1, y1] = view.bounds;
    const tile = (size / scale) * gusjob.UNITS_PER_MM;
    return view.strokes.count / (Math.max(1, (x1 - x0) / tile) * Math.max(1, (y1 - y0) / tile));
  }

  // Draws a tile; returns how many strokes are in it.
  function drawTile(view, canvas, coords, size, scale) {
    const ratio = canvas.width / size;
    const frame = frameOf(coords, size, scale, ratio);
    const ids = idsIn(view, frame);
    const count = ids ? ids.length : view.strokes.count;
    if (!count) return 0;
    const context = canvas.getContext("2d");
    frame.usual = usualCount(view, size, scale);
    if (frame.usual > FEW || count > 4 * FEW) drawPixels(view, frame, context, ids, count);
    else drawLines(view, frame, context, ids || Array.from({ length: count }, (_, i) => i));
    if (view.show.switches) drawSwitches(view, frame, context, ids, count);
    return count;
  }

  gusjob.tiles = { drawTile, isShown, spacingOf };
})();
