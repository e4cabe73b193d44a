/* The page: selection, details, theme, start, and reloading of a watched job's page. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const { element, localized } = gusjob;
  const byId = (id) => document.getElementById(id);
  gusjob.selected = null;

  /* Theme: the system's, or the user's choice. */

  function kept(store, name, value) {
    try { // Storage may be unavailable on a page from a file.
      if (value === undefined) return store().getItem(name);
      if (value === null) store().removeItem(name);
      else store().setItem(name, value);
    } catch (_) { /* Then nothing is stored. */ }
    return null;
  }
  gusjob.kept = kept;
  const local = () => window.localStorage, session = () => window.sessionStorage;

  function setTheme(name) {
    const root = document.documentElement;
    if (name === "auto") delete root.dataset.theme;
    else root.dataset.theme = name;
    if (gusjob.ready) rethemed();
  }

  function rethemed() {
    gusjob.path.retheme();
    gusjob.time.retheme();
  }

  function theme() {
    const choice = byId("theme");
    choice.closest("label").hidden = false;
    const before = kept(local, "gusjob-theme");
    if (before === "dark" || before === "light") {
      choice.value = before;
      setTheme(before);
    }
    choice.addEventListener("change", () => {
      kept(local, "gusjob-theme", choice.value === "auto" ? null : choice.value);
      setTheme(choice.value);
    });
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (gusjob.ready) rethemed(); });
  }

  /* Selection. */

  // Head and value; a long time is in s.
  function entryOf(column, row) {
    const value = column.words ? NaN : column.get(row);
    if (value < 1000 || !/ ms$/.test(column.head)) return [column.head, gusjob.shown(column, row)];
    return [column.head.replace(/ ms$/, " s"), gusjob.figure(value / 1000, 4)];
  }

  function detailsOf(row) {
    const list = element("dl");
    for (const column of gusjob.columnsShown) {
      if (["segment", "line", "file", "kind"].includes(column.name)) continue;
      const [head, text] = entryOf(column, row);
      if (text === "-" || (/^ch\d/.test(column.name) && text === "0")) continue;
      list.append(element("div", {}, element("dt", { title: column.title }, head), element("dd", {}, text)));
    }
    return list;
  }

  function showDetails(row) {
    const title = byId("details-title"), body = byId("details-body");
    // Not `disabled`, since a disabled button loses the keyboard focus at the last segment.
    byId("previous").setAttribute("aria-disabled", String(row === 0));
    byId("next").setAttribute("aria-disabled", String(row === gusjob.count - 1));
    byId("details-hint").hidden = row !== null;
    if (row === null) {
      title.textContent = localized("page", "none-selected");
      body.replaceChildren();
      return;
    }
    const kind = gusjob.kindWord(gusjob.kindOf(row));
    title.textContent = localized("page", "segment", { segment: row + 1, count: gusjob.count, kind, place: gusjob.placeOf(row) });
    body.replaceChildren(detailsOf(row));
    byId("line").value = gusjob.rows.line.values[row];
  }

  function select(row, source) {
    if (row === gusjob.selected || row < 0 || row >= gusjob.count) return;
    gusjob.selected = row;
    showDetails(row);
    gusjob.path.show(row);
    gusjob.time.show(row);
    gusjob.table.show(row, source);
    const hash = `#s=${row}`;
    if (source !== "hash" && location.hash !== hash) {
      try {
        history.replaceState(null, "", hash); // No history entry for each selected segment.
      } catch (_) {
        location.hash = hash;
      }
    }
  }

  // #s=12 selects a segment, #m=3 a mark.
  function fromHash() {
    const [, table, number] = /^#([sm])=(\d{1,9})$/.exec(location.hash) || [];
    if (table === "s") select(Number(number), "hash");
    if (table === "m") selectMark(Number(number));
  }

  function selectMark(mark) {
    const rows = gusjob.tables.marks && gusjob.tables.marks.row;
    if (!rows || mark >= rows.values.length) return;
    gusjob.table.showMark(mark);
    select(rows.values[mark], "marks");
  }

  // Selects the first segment of a line, else of the next line that has one. In a loop: the next one after the selected.
  function toLine() {
    const target = Number(byId("line").value);
    const lines = gusjob.rows.line.values;
    let best = -1;
    const from = gusjob.selected === null ? 0 : gusjob.selected + 1;
    for (let n = 0; n < lines.length; n++) {
      const i = (from + n) % lines.length;
      if (lines[i] === target) { best = i; break; }
      if (lines[i] > target && (best < 0 || lines[i] < lines[best] || (lines[i] === lines[best] && i < best))) best = i;
    }
    byId("line-none").textContent = best < 0 ? localized("page", "no-line", { line: target })
      : lines[best] === target ? "" : localized("page", "next-line", { line: target, next: lines[best] });
    if (best >= 0) select(best, "line");
  }

  function step(by) {
    select(gusjob.selected === null ? (by > 0 ? 0 : gusjob.count - 1) : gusjob.selected + by, "step");
  }

  function selection() {
    byId("previous").addEventListener("click", () => step(-1));
    byId("next").addEventListener("click", () => step(1));
    byId("go").addEventListener("click", toLine);
    byId("line").addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); toLine(); } });
    window.addEventListener("hashchange", () => {
      fromHash();
      byId("map").scrollIntoView({ block: "nearest" });
    });
    showDetails(null);
  }

  /* A watched job: the page is reloaded when the job changes, and keeps its view. */

  const KEPT = `gusjob-view:${location.pathname}`;

  function watch() {
    if (!gusjob.facts.watched) return;
    const source = new EventSource(gusjob.facts.watched);
    const state = byId("watched");
    const changed = () => {
      if (gusjob.ready) {
        const view = { path: gusjob.path.state(), time: gusjob.time.state(), table: gusjob.table.state(), scroll: window.scrollY };
        kept(session, KEPT, JSON.stringify(view));
      }
      source.close();
      location.reload();
    };
    source.addEventListener("message", (event) => { if (event.data === "changed") changed(); });
    source.addEventListener("changed", changed);
    source.addEventListener("open", () => { state.textContent = localized("page", "follows"); });
    source.addEventListener("error", () => { state.textContent = localized("page", "follows-no-more"); });
  }

  function restore() {
    const text = kept(session, KEPT);
    if (!text) return;
    kept(session, KEPT, null);
    try {
      const state = JSON.parse(text);
      gusjob.path.restore(state.path);
      gusjob.time.restore(state.time);
      gusjob.table.restore(state.table);
      window.scrollTo(0, state.scroll);
    } catch (_) { /* The state is of another version of the page: start with the defaults. */ }
  }

  /* Start. */

  async function start() {
    const status = byId("status");
    if (typeof DecompressionStream === "undefined") {
      status.textContent = localized("page", "old-browser");
      return;
    }
    const began = performance.now();
    await gusjob.load((share) => { status.textContent = localized("page", "reading", { share: Math.round(share * 100) }); });
    status.textContent = localized("page", "drawing");
    await gusjob.yieldToBrowser();
    byId("views").hidden = false;
    if (byId("findings")) byId("beside").prepend(byId("findings"));
    gusjob.columnsShown = gusjob.columnsOf("rows");
    await gusjob.path.start();
    await gusjob.yieldToBrowser();
    gusjob.time.start();
    await gusjob.yieldToBrowser();
    gusjob.table.start();
    selection();
    gusjob.ready = true;
    restore();
    fromHash();
    status.textContent = "";
    status.hidden = true;
    gusjob.loadMs = performance.now() - began;
    document.documentElement.dataset.ready = "1";
  }

  gusjob.select = select;
  theme();
  watch();
  if (byId("gusjob-columns")) {
    start().catch((fault) => {
      byId("status").textContent = localized("page", "failed", { why: fault.message });
      console.error(fault);
    });
  }
})();
