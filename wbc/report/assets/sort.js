// Tables whose rows a click in a heading sorts, or Enter on it; once more turns them round.
"use strict";
for (const table of document.querySelectorAll("[data-sorts]")) {
  const body = table.tBodies[0], headings = [...table.tHead.rows[0].cells];
  const number = (text) => (/^[-\d.][\d. ]*(e[-+]?\d+)?$/i.test(text) ? Number(text.replaceAll(" ", "")) : NaN);
  const sort = (heading, k) => {
    const turn = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", turn > 0 ? "ascending" : "descending");
    const keyed = [...body.rows].map((row) => ({ row, text: row.cells[k].textContent.trim() }));
    keyed.sort((a, b) => {
      if ((a.text === "–") !== (b.text === "–")) return a.text === "–" ? 1 : -1;  // nothing stands last
      const x = number(a.text), y = number(b.text);
      return turn * (isNaN(x) || isNaN(y) ? a.text.localeCompare(b.text) : x - y);
    });
    body.append(...keyed.map(({ row }) => row));
  };
  headings.forEach((heading, k) => {
    if (!heading.textContent.trim()) return;
    heading.tabIndex = 0;
    heading.addEventListener("click", () => sort(heading, k));
    heading.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); sort(heading, k); }
    });
  });
}
