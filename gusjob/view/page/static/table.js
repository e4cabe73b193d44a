/* The tables: rows are created when they become visible; sorting and filters work on the columns. */
(function () {
  "use strict";
  const gusjob = window.gusjob;
  const { element } = gusjob;
  const EITHER = ["blank", "notBlank"].map(option);
  const NUMBER_FILTERS = ["equals", "notEqual", "lessThan", "lessThanOrEqual", "greaterThan", "greaterThanOrEqual", "inRange", ...EITHER];
  const WORD_FILTERS = ["contains", "notContains", "equals", "notEqual", "startsWith", "endsWith", ...EITHER];
  const grids = {}; // by table: {api, columns, count, order, name}

  // In the second condition of a filter the grid shows such an option's key instead of its text, unless it is a custom option.
  function option(name) {
    const displayName = gusjob.texts.grid[name];
    return displayName ? { displayKey: name, displayName, numberOfInputs: 0, predicate: () => true } : name;
  }

  let theme = null;
  function themeOf() {
    theme = theme || window.agGrid.themeQuartz.withParams({
      browserColorScheme: "inherit", backgroundColor: "var(--panel)", foregroundColor: "var(--ink)", accentColor: "var(--accent)",
      borderColor: "var(--line)", chromeBackgroundColor: "var(--raised)", headerTextColor: "var(--soft)", fontFamily: "inherit",
      fontSize: 13, spacing: 4, rowHeight: ROW, headerHeight: 30, cellHorizontalPadding: 9, wrapperBorderRadius: 4,
      selectedRowBackgroundColor: "var(--chosen)", rowHoverColor: "var(--hover)", headerFontWeight: 600,
      inputBackgroundColor: "var(--panel)", menuBackgroundColor: "var(--panel)", iconColor: "var(--soft)",
    });
    return theme;
  }

  const ROW = 27, HEADS = 88, LEAST = 190; // px

  const NARROW = { segment: 112, line: 104, kind: 110, stage: 96, channel: 90 };

  function definition(column) {
    const words = !!column.words;
    return {
      colId: column.name, headerName: column.head, headerTooltip: column.title, width: NARROW[column.name] || 120,
      valueGetter: (p) => (p.data ? gusjob.shown(column, p.data.row) : ""), type: words ? undefined : "rightAligned",
      filter: words ? "agTextColumnFilter" : "agNumberColumnFilter",
      filterParams: words ? { filterOptions: WORD_FILTERS, maxNumConditions: 2, debounceMs: 200 }
        : { filterOptions: NUMBER_FILTERS, inRangeInclusive: true, maxNumConditions: 2, debounceMs: 200 },
      pinned: column.name === "segment" && window.innerWidth > 700 ? "left" : undefined,
    };
  }

  function datasourceOf(grid) {
    let known = null;
    return {
      getRows(request) {
        const models = JSON.stringify([request.sortModel, request.filterModel]);
        const fresh = models !== known;
        if (fresh) {
          grid.order = gusjob.chosen(grid.columns, grid.count, request.sortModel, request.filterModel);
          known = models;
          showCount(grid);
        }
        const rows = Array.from(grid.order.subarray(request.startRow, request.endRow), (row) => ({ row }));
        request.successCallback(rows, grid.order.length);
        // These rows get their data later; with a new order the selected row has moved.
        if (grid.targetRow === null) return;
        setTimeout(() => (fresh && grid.name === "segments" ? show(grid.targetRow, "order") : markChosen(grid)), 0);
      },
    };
  }

  const formatCount = (n) => n.toLocaleString("en-US");
  function showCount(grid) {
    document.getElementById(`${grid.name}-count`).textContent =
      gusjob.localized("table", grid.count === 1 ? "one" : "many", { shown: formatCount(grid.order.length), count: formatCount(grid.count) });
  }

  function optionsOf(grid, focused) {
    return {
      theme: themeOf(), localeText: gusjob.texts.grid, rowModelType: "infinite", datasource: datasourceOf(grid), cacheBlockSize: 200, maxBlocksInCache: 30,
      infiniteInitialRowCount: grid.count, blockLoadDebounceMillis: 20, columnDefs: grid.columns.map(definition),
      defaultColDef: { sortable: true, resizable: true, floatingFilter: true, suppressHeaderMenuButton: true, sortingOrder: ["asc", "desc", null] },
      getRowId: (p) => String(p.data.row), rowSelection: { mode: "singleRow", checkboxes: false, enableClickSelection: false },
      suppressRowTransform: true, // A transform is a float32, too coarse for a million rows.
      suppressDragLeaveHidesColumns: true, animateRows: false, suppressColumnMoveAnimation: true, tooltipShowDelay: 400,
      tabToNextCell: () => false, // Tab leaves the grid; the arrow keys move between cells.
      onCellFocused: (event) => {
        const row = grid.order && event.rowIndex !== null ? grid.order[event.rowIndex] : undefined;
        if (row === undefined || grid.moving) return;
        if (grid.name === "marks") {
          const node = grid.api.getRowNode(String(row));
          if (node) node.setSelected(true, true);
        }
        focused(row);
      },
    };
  }

  function make(name, table, focused) {
    const host = document.getElementById(`${name}-grid`);
    const columns = gusjob.columnsOf(table);
    const first = Object.values(gusjob.tables[table])[0];
    const grid = { name, columns, count: first ? first.values.length : 0, order: null, targetRow: null, moving: false };
    grids[name] = grid;
    const high = HEADS + grid.count * ROW; // Few rows need less room.
    if (high < host.clientHeight) host.style.height = `${Math.max(high, LEAST)}px`;
    grid.api = window.agGrid.createGrid(host, optionsOf(grid, focused));
    document.getElementById(`${name}-csv`).addEventListener("click", () => save(grid));
    document.getElementById(`${name}-clear`).addEventListener("click", () => {
      grid.api.setFilterModel(null);
      grid.api.applyColumnState({ defaultState: { sort: null } });
    });
    return grid;
  }

  async function save(grid) {
    const blob = await gusjob.csvOf(grid.columns, grid.order);
    const link = element("a", { href: URL.createObjectURL(blob), download: `${(gusjob.facts.job || "job").replace(/^.*[\\/]/, "").replace(/[^\w.-]/g, "_")}-${grid.name}.csv` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  function markChosen(grid) {
    const node = grid.api.getRowNode(String(grid.targetRow));
    if (!node) return;
    node.setSelected(true, true);
  }

  // Selects a row and scrolls to it, unless the filter hides it.
  function show(row, source) {
    const grid = grids.segments;
    if (!grid) return;
    grid.targetRow = row;
    if (!grid.order) return; // The grid has not requested rows yet; it shows this row when it does.
    grid.api.deselectAll();
    if (row === null) return;
    const place = grid.order.indexOf(row); // One millisecond for a million numbers.
    document.getElementById("segments-hidden").hidden = place >= 0;
    if (place < 0) return;
    if (source !== "table") {
      grid.moving = true;
      grid.api.ensureIndexVisible(place, source === "step" ? null : "middle");
      grid.moving = false;
    }
    markChosen(grid);
  }

  // Selects a mark in its table.
  function showMark(mark) {
    showTab("marks");
    const { api, order } = grids.marks;
    const place = order ? order.indexOf(mark) : mark;
    grids.marks.targetRow = mark;
    if (place < 0) return;
    api.ensureIndexVisible(place, "middle");
    api.deselectAll();
    markChosen(grids.marks);
  }

  function showTab(name) {
    for (const one of ["segments", "marks"]) {
      const tab = document.getElementById(`tab-${one}`), panel = document.getElementById(`${one}-panel`);
      if (!tab) continue;
      tab.setAttribute("aria-selected", String(one === name));
      tab.tabIndex = one === name ? 0 : -1;
      panel.hidden = one !== name;
    }
    if (name === "marks" && !grids.marks) {
      const rows = gusjob.tables.marks.row;
      make("marks", "marks", (mark) => { if (rows) gusjob.select(rows.values[mark], "marks"); });
    }
  }

  function tabs() {
    const both = ["segments", "marks"].map((name) => document.getElementById(`tab-${name}`));
    if (!both[1]) return;
    both.forEach((tab, n) => {
      tab.addEventListener("click", () => showTab(tab.id.slice(4)));
      tab.addEventListener("keydown", (event) => {
        if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
        const other = both[1 - n];
        showTab(other.id.slice(4));
        other.focus();
      });
    });
  }

  function start() {
    tabs();
    make("segments", "rows", (row) => gusjob.select(row, "table"));
  }

  function state() {
    const kept = {};
    for (const [name, grid] of Object.entries(grids)) {
      kept[name] = { filter: grid.api.getFilterModel(), sort: grid.api.getColumnState().map(({ colId, sort, sortIndex }) => ({ colId, sort, sortIndex })) };
    }
    return { grids: kept, tab: document.getElementById("marks-panel") && !document.getElementById("marks-panel").hidden ? "marks" : "segments" };
  }

  function restore(kept) {
    if (kept.tab === "marks" && document.getElementById("tab-marks")) showTab("marks");
    for (const [name, one] of Object.entries(kept.grids)) {
      if (!grids[name]) continue;
      grids[name].api.setFilterModel(one.filter);
      grids[name].api.applyColumnState({ state: one.sort });
    }
  }

  gusjob.table = { start, show, showMark, showTab, state, restore, grids };
})();
