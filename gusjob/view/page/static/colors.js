/* Color scales of the path view. Palette and ranges come with the page; pictures have the same. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const parsed = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));

  function isDark() {
    const set = document.documentElement.dataset.theme;
    return set ? set === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
  }

  // Colors of values: below the range, the scale from low to high, above the range.
  function palette(single) {
    const { scale, under, over, single: one } = gusjob.facts.palette[isDark() ? "dark" : "light"];
    return [under, ...(single ? scale.map(() => one) : scale), over].map(parsed);
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

  // The quantities of the color scale: value(i) of a stroke with emission; NaN if it has none.
  function measures(strokes, emission) {
    const perMm = strokes.values(`ch${emission.channel}_per_mm`);
    return {
      power: { word: gusjob.localized("measures", "power"), unit: emission.unit, value: (i) => emission.power[i] },
      energy: { word: gusjob.localized("measures", "energy"), unit: `${emission.unit}\u00b7ms/mm`, value: (i) => perMm[i] },
      velocity: { word: gusjob.localized("measures", "velocity"), unit: "mm/s", value: (i) => (strokes.vel0[i] + strokes.vel1[i]) / 2 },
      order: { word: gusjob.localized("measures", "order"), unit: "ms", value: (i) => strokes.start[i] },
    };
  }

  // Range of a quantity, in the units of its labels; null: no values.
  function rangeOf(emission, name) {
    const known = (gusjob.facts.ranges || []).find((one) => one.channel === emission.channel && one.index === emission.index);
    if (!known || !known[name]) return null;
    const [low, high, least, most] = known[name];
    return { low, high, least, most, single: gusjob.figure(low, 4) === gusjob.figure(high, 4) };
  }

  // Of each stroke: 0 without emission, 255 with emission of another channel only, else 1 + its place in the palette.
  function binsOf(strokes, emissions, emission, name) {
    const bins = new Uint8Array(strokes.count);
    if (!emission) return { bins, range: null, measure: null };
    const measure = measures(strokes, emission)[name];
    const range = rangeOf(emission, name);
    const count = gusjob.facts.palette.light.scale.length;
    const near = Math.pow(10, 1 - (gusjob.facts.digits || 6)); // Values are rounded.
    const placeOf = (v) => {
      if (!range || Number.isNaN(v) || v > range.high + near * Math.abs(range.high)) return count + 1;
      if (v < range.low - near * Math.abs(range.low)) return 0;
      const share = range.single ? 0 : (v - range.low) / (range.high - range.low);
      return 1 + Math.max(0, Math.min(count - 1, Math.floor(share * count)));
    };
    for (let i = 0; i < strokes.count; i++) {
      if (gusjob.isEmitting(emission, i)) bins[i] = 1 + placeOf(measure.value(i));
      else if (emissions.some((other) => gusjob.isEmitting(other, i))) bins[i] = 255;
    }
    return { bins, range, measure };
  }

  Object.assign(gusjob, { colors: { palette, css, resolved, isDark, binsOf } });
})();
