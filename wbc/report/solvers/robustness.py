"""The torture table: malformed and degenerate problems, with the checks of the library and without."""

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
        f"Malformed and degenerate problems. Without checks, {len(solvers)} of {len(data['solvers'])} back ends report "
        f"a wrong solution, hang or crash ({', '.join(solvers) or 'none'}). With the checks of this library "
        + (f"{len(wrong)} results are wrong." if wrong else "every result is right.")
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
        "guarded": "With the checks of the library before and its certificate after. ✗: wrong result.",
        "alone": (
            "The back end alone. ✗: wrong result; wrong: the back end reports solved and the certificate fails; a "
            "signal: the process crashed."
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


_SHORT = {"wrong: says solved": "wrong", "max_iterations": "stops", "failed": "stops"}
