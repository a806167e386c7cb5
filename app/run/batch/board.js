/** Sorting, marking and narrowing the tables of a leaderboard. */

for (const table of document.querySelectorAll("table")) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];
  const rows = () => [...body.rows];
  const number = (row, column, name) => Number(row.cells[column].dataset[name] ?? Infinity);

  // Of each measure the nearest to the recorded motion.
  heads.forEach((_, column) => {
    const scored = rows().filter((row) => !row.classList.contains("recorded") && row.cells[column].dataset.apart !== undefined);
    if (scored.length < 2) return;
    const least = Math.min(...scored.map((row) => number(row, column, "apart")));
    for (const row of scored) row.cells[column].classList.toggle("best", number(row, column, "apart") === least);
  });

  heads.forEach((head, column) => {
    head.querySelector("button")?.addEventListener("click", () => {
      const isAgain = head.getAttribute("aria-sort") === "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", isAgain ? "descending" : "ascending");
      const sorted = rows().sort((a, b) => {
        if (!column) return a.cells[0].textContent.localeCompare(b.cells[0].textContent) * (isAgain ? -1 : 1);
        if (isAgain) return number(b, column, "value") - number(a, column, "value");
        return (number(a, column, "apart") - number(b, column, "apart")) || 0; // neither has one
      });
      body.append(...sorted);
    });
  });
}

document.getElementById("all").addEventListener("change", ({ target }) => document.body.classList.toggle("all", target.checked));
document.getElementById("only").addEventListener("input", ({ target }) => {
  const wanted = target.value.trim().toLowerCase();
  for (const row of document.querySelectorAll("tbody tr")) {
    row.hidden = !row.classList.contains("recorded") && !row.cells[0].textContent.toLowerCase().includes(wanted);
  }
});
