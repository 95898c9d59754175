"""The torture table: problems that nobody should have to solve, behind the library's checks and without them."""

from __future__ import annotations

from wbc.report.document import Cell, Item, Marked, Section, Table, Text
from wbc.report.solvers.data import Data


def section(data: Data) -> Section:
    """Two tables with one row a case: through the library, and the back end alone."""
    if not data["torture"]:
        return Section("Torture", [])
    guarded, alone = (_table(data, how) for how in ("guarded", "alone"))
    worse = [
        x for x in data["torture"] if x["how"] == "alone" and ("lost" in x or x.get("word", "").startswith("wrong"))
    ]
    solvers = list(dict.fromkeys(x["solver"] for x in worse))
    wrong = [x for x in data["torture"] if x["how"] == "guarded" and not x.get("right", False)]
    text = (
        f"Each case in the solver's own process. Alone, {len(solvers)} of {len(data['solvers'])} back ends call "
        f"something solved that is not, hang or crash ({', '.join(solvers) or 'none'}). Behind the checks of this "
        "library " + (f"{len(wrong)} ends are not the right one." if wrong else "every end is the right one.")
    )
    items: list[Item] = [Text(text), guarded, alone]
    return Section("Torture", items)


def _table(data: Data, how: str) -> Table:
    solvers = [solver["name"] for solver in data["solvers"]]
    found = {(x["case"], x["solver"]): x for x in data["torture"] if x["how"] == how}
    rows: list[list[Cell]] = []
    for case in dict.fromkeys(case for case, _ in found):
        rows.append([case, *(_cell(found.get((case, solver))) for solver in solvers)])
    caption = {
        "guarded": "Through the library: checked before, certified after. ✗: not the right end.",
        "alone": (
            "The back end's own word, nothing checked before. ✗: not the right end; wrong: it says solved, and that "
            "is not so; a signal: it took the process with it."
        ),
    }
    return Table(("case", *solvers), rows, caption[how])


def _cell(finding: Data | None) -> Cell:
    if finding is None:
        return "–"
    if "lost" in finding:
        reason = str(finding["lost"]).removeprefix("crashed: ")
        return Marked(f"✗ {'hangs' if reason.startswith('no answer') else reason}", "bad")
    word = _SHORT.get(finding["word"], str(finding["word"]).partition(" ")[0])
    return word if finding["right"] else Marked(f"✗ {word}", "bad")


_SHORT = {"wrong: says solved": "wrong", "max_iterations": "gives up", "failed": "gives up"}
