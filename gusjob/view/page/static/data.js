/* The data: facts, decoded columns, number formats, sorting and filtering of rows. */
(function () {
  "use strict";
  const gusjob = (window.gusjob = window.gusjob || {});
  const ARRAYS = { f32: Float32Array, i8: Int8Array, i16: Int16Array, i32: Int32Array };
  const PIECE = 1 << 20; // characters of base64 at a time; a multiple of four

  function readJson(id) {
    const node = document.getElementById(id);
    return node ? JSON.parse(node.textContent) : null;
  }

  gusjob.facts = readJson("gusjob-facts");
  gusjob.texts = readJson("gusjob-texts") || {};
  const UNITS_PER_MM = (gusjob.facts || {}).units_per_mm || 10000;

  const WIDE = /[\u2e80-\ua4cf\uf900-\ufaff\uff00-\uff60]/;
  const isWide = (text, at) => WIDE.test(text.charAt(at));

  // Fills the fields of a text; there is no space between Chinese text and a Chinese field.
  function filled(text, fields) {
    return text.replace(/( ?)\{(\w+)\}( ?)/g, (_, before, name, behind, from) => {
      const value = String(fields[name]);
      const to = from + before.length + name.length + 2 + behind.length;
      const joined = (blank, here, there) => (here && there ? "" : blank);
      return joined(before, isWide(text, from - 1), isWide(value, 0)) + value
        + joined(behind, isWide(text, to), isWide(value, value.length - 1));
    });
  }

  // A text of the page in the user's language, by script and key.
  const localized = (script, name, fields) => filled(gusjob.texts[script][name], fields || {});

  // Lets the browser paint and respond between long steps.
  function yieldToBrowser() {
    return new Promise((done) => setTimeout(done, 0));
  }

  function fromBase64(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return bytes;
  }

  // Returns a function that reads exactly `count` bytes of a stream.
  function byteReader(stream) {
    const reader = stream.getReader();
    let left = new Uint8Array(0);
    return async function take(count) {
      const out = new Uint8Array(count);
      let at = 0;
      while (at < count) {
        if (!left.length) {
          const next = await reader.read();
          if (next.done) throw new Error(localized("data", "cut-off"));
          left = next.value;
        }
        const some = left.subarray(0, count - at);
        out.set(some, at);
        at += some.length;
        left = left.subarray(some.length);
      }
      return out;
    };
  }

  function unshuffled(raw, Type, count) {
    const width = Type.BYTES_PER_ELEMENT;
    if (width === 1) return new Type(raw.buffer, 0, count);
    const out = new Uint8Array(raw.length);
    for (let b = 0; b < width; b++) {
      const from = b * count;
      for (let i = 0, to = b; i < count; i++, to += width) out[to] = raw[from + i];
    }
    return new Type(out.buffer);
  }

  // A column that is computed from others; 0 times NaN (the power while the laser is off) is 0.
  function computed(entry, table) {
    const [a, b] = entry.of.map((name) => table[name].values);
    const out = new Float32Array(entry.count);
    for (let i = 0; i < entry.count; i++) {
      if (!b) out[i] = a[i] * entry.factor;
      else if (entry.how === "quotient") out[i] = (a[i] / b[i]) * entry.factor;
      else out[i] = b[i] === 0 ? 0 : a[i] * b[i] * entry.factor;
    }
    return out;
  }

  async function unpack(text, directory, onProgress) {
    const gunzip = new DecompressionStream("gzip");
    const writer = gunzip.writable.getWriter();
    const fed = (async () => {
      for (let at = 0; at < text.length; at += PIECE) {
        await writer.write(fromBase64(text.slice(at, at + PIECE)));
        onProgress(Math.min(1, (at + PIECE) / text.length));
      }
      await writer.close();
    })();
    const take = byteReader(gunzip.readable);
    const arrays = [];
    const tables = {};
    for (const entry of directory) {
      let values;
      if (entry.how) values = computed(entry, tables[entry.table]);
      else if (entry.same >= 0) values = arrays[entry.same];
      else {
        const Type = ARRAYS[entry.type];
        values = unshuffled(await take(entry.count * Type.BYTES_PER_ELEMENT), Type, entry.count);
        if (entry.delta) for (let i = 1; i < values.length; i++) values[i] += values[i - 1];
      }
      arrays.push(values);
      (tables[entry.table] = tables[entry.table] || {})[entry.name] = { name: entry.name, values, scale: entry.scale };
    }
    await fed;
    return tables;
  }

  const at = (column, i) => (column.scale ? column.values[i] / column.scale : column.values[i]);

  // Starts of segments, summed in double precision: float32 is too coarse for a long job.
  function startsOf(durations) {
    const starts = new Float64Array(durations.length + 1);
    for (let i = 0; i < durations.length; i++) starts[i + 1] = starts[i] + durations[i];
    return starts;
  }

  function nodesOf(column, startMm) {
    const nodes = new Int32Array(column.values.length + 1);
    nodes[0] = Math.round(startMm * UNITS_PER_MM);
    nodes.set(column.values, 1);
    return nodes;
  }

  // Strokes as arrays: stroke i goes from node i to node i + 1, in units.
  function strokesOf(facts, rows, found, count) {
    const values = (name) => found[name] && found[name].values;
    const row = values("row");
    const first = new Uint32Array(count + 1);
    for (let i = row.length - 1, r = count; r >= 0; r--) {
      while (i >= 0 && row[i] >= r) i--;
      first[r] = i + 1;
    }
    first[count] = row.length;
    const start = new Float64Array(row.length + 1);
    const duration = values("duration_ms");
    for (let i = 0; i < row.length; i++) {
      // Restarts at each segment, so that rounding errors of the strokes do not add up.
      const from = first[row[i]] === i ? rows.starts[row[i]] : start[i];
      start[i] = from;
      start[i + 1] = from + duration[i];
    }
    const [x0, y0] = facts.start_mm;
    const strokes = {
      count: row.length, row, first, start, duration,
      x: nodesOf(found.x_mm, x0), y: nodesOf(found.y_mm, y0),
      vel0: values("vel0"), vel1: values("vel1"), beam: null, values,
    };
    if (found.beam_x_mm) {
      const [bx, by] = facts.beam_start_mm || facts.start_mm;
      strokes.beam = { x: nodesOf(found.beam_x_mm, bx), y: nodesOf(found.beam_y_mm, by) };
    }
    return strokes;
  }

  // Emission of the lasers: one entry per channel and power unit.
  function emissionsOf(facts, strokes) {
    const emissions = [];
    for (const one of facts.channels || []) {
      const name = `ch${one.channel}`;
      const on = strokes.values(`${name}_on`);
      const power = strokes.values(`${name}_power`);
      if (!on || !power) continue;
      const units = one.units || [one.unit];
      const unitOf = strokes.values(`${name}_unit`);
      units.forEach((unit, index) => {
        emissions.push({ channel: one.channel, unit, on, power, unitOf: unitOf && units.length > 1 ? unitOf : null, index });
      });
    }
    return emissions;
  }

  const isEmitting = (emission, i) => emission.on[i] !== 0 && (!emission.unitOf || emission.unitOf[i] === emission.index);

  async function load(onProgress) {
    const facts = gusjob.facts;
    const node = document.getElementById("gusjob-columns");
    const text = node.textContent;
    node.remove(); // The text is large, and no longer needed.
    const tables = await unpack(text, facts.directory, onProgress);
    const rows = tables.rows;
    const count = rows.line.values.length;
    rows.starts = startsOf(rows.duration_ms.values);
    gusjob.tables = tables;
    gusjob.rows = rows;
    gusjob.count = count;
    await yieldToBrowser();
    gusjob.strokes = strokesOf(facts, rows, tables.strokes, count);
    gusjob.emissions = emissionsOf(facts, gusjob.strokes);
  }

  // A number with six digits, or fewer if the page had to round; never with an exponent.
  function figure(value, digits) {
    if (value === null || value === undefined || Number.isNaN(value)) return "-";
    if (!Number.isFinite(value)) return String(value);
    const short = Number(value.toPrecision(digits || gusjob.facts.digits || 6));
    if (short === 0) return "0";
    const text = String(short);
    if (!text.includes("e")) return text;
    if (Math.abs(short) > 1) {
      const [mantissa, power] = text.split("e");
      const after = (mantissa.split(".")[1] || "").length;
      return mantissa.replace(".", "") + "0".repeat(Number(power) - after);
    }
    return short.toFixed(Math.min(100, 5 - Math.floor(Math.log10(Math.abs(short))))).replace(/0+$/, "");
  }

  // A figure whose digits before the point are all there, as in the report.
  function short(value, digits) {
    return Number.isFinite(value) && Math.abs(value) >= 10 ** digits ? value.toFixed(0) : figure(value, digits);
  }

  // As in the other formats of the report: control characters (such as bidi controls) become U+FFFD.
  function printable(text) {
    return String(text).replace(/\t/g, " ").replace(/\p{C}|(?! )\p{Z}/gu, "\ufffd");
  }

  const kindOf = (row) => gusjob.facts.kinds[gusjob.rows.kind.values[row]];
  const kindWord = (kind) => gusjob.texts.kinds[kind] || "?";
  const kindName = (kind) => (kind || "?").replace("_", "-"); // in files, whatever the language
  function fileOf(row) {
    const files = gusjob.facts.notes && gusjob.facts.notes.files;
    const column = gusjob.rows.file;
    return files && column ? printable(files[column.values[row]] || "") : "";
  }
  function placeOf(row) {
    const file = fileOf(row);
    const line = gusjob.rows.line.values[row];
    return file ? localized("data", "line-of-file", { line, file }) : localized("data", "line", { line });
  }

  // [short head, description]
  function headOf(name) {
    const { heads, headsOfChannel, ofChannel, unitOfChannel } = gusjob.texts;
    if (heads[name]) return heads[name];
    const [, number, what] = /^ch(\d+)_(.+)$/.exec(name) || [];
    if (what === "unit") return [filled(unitOfChannel, { channel: number }), filled(unitOfChannel, { channel: number })];
    const known = headsOfChannel[what];
    if (!known) return [name, name];
    const channel = (gusjob.facts.channels || []).find((one) => one.channel === Number(number));
    const unit = printable(channel ? (channel.units || [channel.unit]).join("/") : "");
    return known.map((text, n) => filled(ofChannel[n], { channel: number, what: filled(text, { unit }) }));
  }

  // The units of a channel whose mode changes, in the order of its unit column.
  function unitsOf(name) {
    const channel = (gusjob.facts.channels || []).find((one) => `ch${one.channel}_unit` === name);
    return ((channel && channel.units) || []).map(printable);
  }

  // A column of a table for the grid, sorting and CSV. `words`: texts of an index column, for CSV and sorting; `shown`: the
  // texts for display and filters, if they differ.
  function columnOf(name, get, rest) {
    const [head, title] = headOf(name);
    return Object.assign({ name, head, title, get, words: null, shown: null, ascending: false, keep: false }, rest);
  }

  function columnsOf(table) {
    const found = gusjob.tables[table];
    const columns = [];
    const count = Object.values(found)[0].values.length;
    if (table === "rows") columns.push(columnOf("segment", (i) => i + 1, { ascending: true, whole: true }));
    for (const [name, column] of Object.entries(found)) {
      if (name === "starts" || (table === "marks" && name === "row")) continue;
      if (name === "duration_ms" && table === "rows") {
        columns.push(columnOf("start_ms", (i) => found.starts[i], { ascending: true }));
      }
      const own = { source: column, whole: !column.scale && !(column.values instanceof Float32Array) };
      if (table === "rows" && name === "kind") Object.assign(own, { words: gusjob.facts.kinds.map(kindName), shown: gusjob.facts.kinds.map(kindWord) });
      if (/^ch\d+_unit$/.test(name)) own.words = unitsOf(name);
      if (name === "file") own.words = ((gusjob.facts.notes || {}).files || []).map(printable);
      if (column.values instanceof Float32Array && count && column.values.every(Number.isNaN)) continue;
      if (/_clamped_ms$/.test(name) && !column.values.some((v) => v > 0)) continue;
      columns.push(columnOf(name, column.scale ? (i) => at(column, i) : (i) => column.values[i], own));
    }
    const places = { line: 1, file: 2, kind: 3, stage: 4 };
    const place = (c) => (c.name === "segment" ? 0 : places[c.name] || 9);
    return columns.map((c, i) => [c, i]).sort((a, b) => place(a[0]) - place(b[0]) || a[1] - b[1]).map((pair) => pair[0]);
  }

  function shown(column, i) {
    const value = column.get(i);
    if (column.words) return (column.shown || column.words)[value] || "?";
    return column.whole ? String(value) : cellText(column, value);
  }

  // Places and starts keep all their digits; measured values have four.
  const EXACT = ["x_mm", "y_mm", "start_ms"];
  function cellText(column, value) {
    return EXACT.includes(column.name) ? figure(value) : short(value, Math.min(4, gusjob.facts.digits || 6));
  }

  // Keys that sort as unsigned integers like the values; NaN comes last in both directions.
  function keysOf(column, count, down) {
    const keys = new Uint32Array(count);
    const flip = down ? 0xffffffff : 0;
    if (column.ascending) {
      for (let i = 0; i < count; i++) keys[i] = i ^ flip;
      return keys;
    }
    const values = column.source.values;
    if (column.words) {
      const ranks = column.words.slice().sort();
      const rank = column.words.map((word) => ranks.indexOf(word));
      for (let i = 0; i < count; i++) keys[i] = rank[values[i]] ^ flip;
    } else if (values instanceof Float32Array) {
      const bits = new Uint32Array(values.buffer, values.byteOffset, count);
      for (let i = 0; i < count; i++) {
        const b = values[i] === 0 ? 0 : bits[i];
        keys[i] = Number.isNaN(values[i]) ? 0xffffffff : (b & 0x80000000 ? ~b : b | 0x80000000) ^ flip;
      }
    } else {
      for (let i = 0; i < count; i++) keys[i] = (values[i] ^ 0x80000000) ^ flip;
    }
    return keys;
  }

  // Stable radix sort, 11 bits at a time: a comparison sort of a million rows takes seconds.
  function sorted(order, keys) {
    let from = order;
    let to = new Uint32Array(order.length);
    for (let shift = 0; shift < 33; shift += 11) {
      const counts = new Uint32Array(2049);
      for (let i = 0; i < from.length; i++) counts[((keys[from[i]] >>> shift) & 2047) + 1]++;
      for (let b = 0; b < 2048; b++) counts[b + 1] += counts[b];
      for (let i = 0; i < from.length; i++) to[counts[(keys[from[i]] >>> shift) & 2047]++] = from[i];
      [from, to] = [to, from === order ? new Uint32Array(order.length) : from];
    }
    return from;
  }

  // "Equal" means an equal displayed text: a user can't type a float32.
  function sameFigure(column, value, target) {
    if (column.whole) return value === target;
    if (Math.abs(value - target) > 1e-2 * Math.abs(target)) return false;
    return cellText(column, value) === cellText(column, target);
  }

  function numberTest(column, one) {
    const a = one.filter, b = one.filterTo;
    const same = (v, w) => sameFigure(column, v, w);
    switch (one.type) {
      case "equals": return (v) => same(v, a);
      case "notEqual": return (v) => !Number.isNaN(v) && !same(v, a);
      case "lessThan": return (v) => v < a && !same(v, a);
      case "lessThanOrEqual": return (v) => v <= a || same(v, a);
      case "greaterThan": return (v) => v > a && !same(v, a);
      case "greaterThanOrEqual": return (v) => v >= a || same(v, a);
      case "inRange": return (v) => (v >= a || same(v, a)) && (v <= b || same(v, b));
      case "blank": return (v) => Number.isNaN(v);
      case "notBlank": return (v) => !Number.isNaN(v);
      default: return () => true;
    }
  }

  function wordTest(column, one) {
    const target = (one.filter || "").toLowerCase();
    const fits = {
      contains: (w) => w.includes(target), notContains: (w) => !w.includes(target), equals: (w) => w === target,
      notEqual: (w) => w !== target, startsWith: (w) => w.startsWith(target), endsWith: (w) => w.endsWith(target),
      blank: (w) => !w, notBlank: (w) => !!w,
    }[one.type] || (() => true);
    const known = (column.shown || column.words).map((word) => fits(word.toLowerCase()));
    return (v) => known[v];
  }

  function testOf(column, model) {
    const one = (m) => (column.words ? wordTest(column, m) : numberTest(column, m));
    if (!model.conditions) return one(model);
    const tests = model.conditions.map(one);
    return model.operator === "OR" ? (v) => tests.some((t) => t(v)) : (v) => tests.every((t) => t(v));
  }

  // Rows that pass the grid's filters, in the order of its sort model.
  function chosen(columns, count, sortModel, filterModel) {
    const byName = new Map(columns.map((column) => [column.name, column]));
    const tests = Object.entries(filterModel || {}).filter(([name]) => byName.has(name))
      .map(([name, model]) => [byName.get(name).get, testOf(byName.get(name), model)]);
    let order = new Uint32Array(count);
    let kept = 0;
    for (let i = 0; i < count; i++) {
      if (tests.every(([get, test]) => test(get(i)))) order[kept++] = i;
    }
    order = order.slice(0, kept);
    for (const sort of (sortModel || []).slice().reverse()) {
      const column = byName.get(sort.colId);
      if (column) order = sorted(order, keysOf(column, count, sort.sort === "desc"));
    }
    return order;
  }

  function csvText(column, i) {
    const value = column.get(i);
    if (!column.words) return Number.isNaN(value) ? "" : column.whole ? String(value) : figure(value, 9);
    const word = column.words[value] || "";
    // A spreadsheet would run such a text as a formula.
    const safe = /^[=+\-@\t\r]/.test(word) ? `'${word}` : word;
    return /[",\r\n]/.test(safe) ? `"${safe.replace(/"/g, '""')}"` : safe;
  }

  async function csvOf(columns, order) {
    const parts = [columns.map((c) => c.name).join(",") + "\r\n"];
    for (let first = 0; first < order.length; first += 20000) {
      const lines = [];
      for (let i = first; i < Math.min(order.length, first + 20000); i++) {
        lines.push(columns.map((c) => csvText(c, order[i])).join(","));
      }
      parts.push(lines.join("\r\n") + "\r\n");
      await yieldToBrowser();
    }
    return new Blob(parts, { type: "text/csv" });
  }

  function element(tag, attributes, ...children) {
    const node = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes || {})) node.setAttribute(name, value);
    node.append(...children); // Strings become text nodes, so that markup in a job's text has no effect.
    return node;
  }

  Object.assign(gusjob, {
    UNITS_PER_MM, yieldToBrowser, load, figure, short, printable, kindOf, kindWord, fileOf, placeOf, headOf, columnsOf, shown, chosen,
    csvOf, element, isEmitting, localized,
  });
})();
