/* Colour scales for the path view: perceptual, and the highest value always stands out most from the background. */
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

  // On black the scale ends in yellow, on white in purple; the end that the background would swallow is left out.
  const scaleAt = (share, dark) => stopAt(dark ? 0.22 + 0.78 * share : 0.8 - 0.8 * share);

  function palette(dark) {
    return Array.from({ length: BINS }, (_, bin) => scaleAt(bin / (BINS - 1), dark));
  }

  const css = (rgb) => `rgb(${rgb[0]}, ${rgb[1]}, ${rgb[2]})`;

  // The stylesheet's colour as the browser resolves it (it may differ between light and dark).
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

  // What strokes can be coloured by: value(i) of a lit stroke; NaN where there is none.
  function measures(strokes, light) {
    const beam = strokes.beam || strokes;
    const lengthMm = (i) => Math.hypot(beam.x[i + 1] - beam.x[i], beam.y[i + 1] - beam.y[i]) / gusjob.UNITS_PER_MM;
    return {
      power: { word: gusjob.said("measures", "power"), unit: light.unit, value: (i) => light.power[i] },
      energy: {
        word: gusjob.said("measures", "energy"), unit: `${light.unit}*ms/mm`,
        value: (i) => { const mm = lengthMm(i); return mm > 0 ? (light.power[i] * strokes.duration[i]) / mm : NaN; },
      },
      velocity: { word: gusjob.said("measures", "velocity"), unit: "mm/s", value: (i) => (strokes.vel0[i] + strokes.vel1[i]) / 2 },
      order: { word: gusjob.said("measures", "order"), unit: "ms", value: (i) => strokes.start[i] },
    };
  }

  // Lowest and highest; of energy per mm without the few extremes that starts from rest give.
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

  // Of each stroke: 0 dark, 255 lit by another channel only, else 1 + its colour.
  function binsOf(strokes, lights, light, name) {
    const bins = new Uint8Array(strokes.count);
    if (!light) return { bins, range: null, measure: null };
    const measure = measures(strokes, light)[name];
    const values = new Float64Array(strokes.count);
    let count = 0;
    for (let i = 0; i < strokes.count; i++) {
      if (!gusjob.isLit(light, i)) continue;
      const v = measure.value(i);
      if (!Number.isNaN(v)) values[count++] = v;
    }
    const range = rangeOf(values.subarray(0, count), name === "energy");
    const k = range && range.high > range.low ? (BINS - 1) / (range.high - range.low) : 0;
    for (let i = 0; i < strokes.count; i++) {
      if (gusjob.isLit(light, i)) {
        const v = measure.value(i);
        bins[i] = 1 + (Number.isNaN(v) || !k ? BINS - 1 : Math.max(0, Math.min(BINS - 1, Math.round((v - range.low) * k))));
      } else if (lights.some((other) => gusjob.isLit(other, i))) bins[i] = 255;
    }
    return { bins, range, measure };
  }

  Object.assign(gusjob, { colors: { BINS, palette, scaleAt, css, resolved, isDark, binsOf } });
})();
