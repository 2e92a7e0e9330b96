"use strict";
(() => {
  const number = (text) => parseFloat(text.replace(/^[^\d−-]+/, "").replace("−", "-"));
  const text = (row, i) => row.cells[i].textContent.trim();
  // what begins with numbers in both rows is ordered by these, other text as people do
  function order(a, b) {
    const [x, y] = [number(a), number(b)];
    if (!Number.isNaN(x) && !Number.isNaN(y)) return x - y;
    return a.localeCompare(b, undefined, { numeric: true });
  }
  function sort(table, i, head) {
    const down = head.getAttribute("aria-sort") === "ascending", body = table.tBodies[0], groups = [];
    // a row of words stays below the row that it belongs to
    for (const row of body.rows) row.classList.contains("warning") ? groups.at(-1).push(row) : groups.push([row]);
    groups.sort(([a], [b]) => (down ? -1 : 1) * order(text(a, i), text(b, i)));
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    body.append(...groups.flat());
  }
  for (const table of document.querySelectorAll("table")) {
    if (!table.tHead || table.tBodies[0].rows.length < 2) continue;
    [...table.tHead.rows[0].cells].forEach((head, i) => {
      head.tabIndex = 0;
      head.title = "Sort by this column";
      head.classList.add("sort");
      head.addEventListener("click", () => sort(table, i, head));
      head.addEventListener("keydown", (event) => {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); sort(table, i, head); }
      });
    });
  }
})();
