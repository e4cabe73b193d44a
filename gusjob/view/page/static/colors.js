/* Color scales of the path view: perceptual; the highest value has most contrast with the background. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const BINS = 48;
  // Nine stops of viridis, dark purple to yellow.
  const VIRIDIS = [
    [68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99],
    [170, 220, 50], [253, 231, 37],
  ];

  function stopAt(share) {
    const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1);
    const low = Math.min(Math.floor(at), VIRIDIS.length - 2);
    return VIRIDIS[low].map((v, c) => Math.round(v + (VIRIDIS[low + 1][c] - v) * (at - low)));
  }

  // The scale ends in yellow on black, in purple on white, without the end that is like the background.
  const scaleAt = (share, dark) => stopAt(dark ? 0.22 + 0.78 * share : 0.8 - 0.8 * share);

  function palette(dark) {
    return Array.from({ length: BINS }, (_, bin) => scaleAt(bin / (BINS - 1), dark));
  }

  const css = (rgb) => `rgb(${rgb[0]}, ${rgb[1]}, ${rgb[2]})`;

  // A color of the style sheet as the browser resolves it (it may depend on the theme).
  function resolved(name) {
    const probe = gusjob.element("span", { hidden: "" });
    probe.style.color = `var(${name})`;
    document.body.append(probe);
    const text = getComputedStyle(probe).color;
    probe.remove();
    return text;
  }

  function isDark() {
    const set = document.documentElement.dataset.theme;
    return set ? set === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
  }

  // The quantities of the color scale: value(i) of a stroke with emission; NaN if it has none.
  function measures(strokes, emission) {
    const beam = strokes.beam || strokes;
    const lengthMm = (i) => Math.hypot(beam.x[i + 1] - beam.x[i], beam.y[i + 1] - beam.y[i]) / gusjob.UNITS_PER_MM;
    return {
      power: { word: gusjob.localized("measures", "power"), unit: emission.unit, value: (i) => emission.power[i] },
      energy: {
        word: gusjob.localized("measures", "energy"), unit: `${emission.unit}*ms/mm`,
        value: (i) => { const mm = lengthMm(i); return mm > 0 ? (emission.power[i] * strokes.duration[i]) / mm : NaN; },
      },
      velocity: { word: gusjob.localized("measures", "velocity"), unit: "mm/s", value: (i) => (strokes.vel0[i] + strokes.vel1[i]) / 2 },
      order: { word: gusjob.localized("measures", "order"), unit: "ms", value: (i) => strokes.start[i] },
    };
  }

  // Range of values; of energy per mm without the few extreme values at starts from rest.
  function rangeOf(values, trimmed) {
    let low = Infinity, high = -Infinity;
    for (const v of values) {
      if (v < low) low = v;
      if (v > high) high = v;
    }
    if (!(low <= high)) return null;
    const range = { low, high, cut: false };
    if (!trimmed || values.length < 20) return range;
    const step = Math.ceil(values.length / 100000);
    const some = Float64Array.from({ length: Math.floor(values.length / step) }, (_, i) => values[i * step]).sort();
    const most = some[Math.floor((some.length - 1) * 0.98)];
    if (most > 0 && high > 1.5 * most) Object.assign(range, { high: most, cut: true });
    return range;
  }

  // Of each stroke: 0 without emission, 255 with emission of another channel only, else 1 + its color.
  function binsOf(strokes, emissions, emission, name) {
    const bins = new Uint8Array(strokes.count);
    if (!emission) return { bins, range: null, measure: null };
    const measure = measures(strokes, emission)[name];
    const values = new Float64Array(strokes.count);
    let count = 0;
    for (let i = 0; i < strokes.count; i++) {
      if (!gusjob.isEmitting(emission, i)) continue;
      const v = measure.value(i);
      if (!Number.isNaN(v)) values[count++] = v;
    }
    const range = rangeOf(values.subarray(0, count), name === "energy");
    const k = range && range.high > range.low ? (BINS - 1) / (range.high - range.low) : 0;
    for (let i = 0; i < strokes.count; i++) {
      if (gusjob.isEmitting(emission, i)) {
        const v = measure.value(i);
        bins[i] = 1 + (Number.isNaN(v) || !k ? BINS - 1 : Math.max(0, Math.min(BINS - 1, Math.round((v - range.low) * k))));
      } else if (emissions.some((other) => gusjob.isEmitting(other, i))) bins[i] = 255;
    }
    return { bins, range, measure };
  }

  Object.assign(gusjob, { colors: { BINS, palette, scaleAt, css, resolved, isDark, binsOf } });
})();
