"""What stands at the end: failures with their files, every setting, and what the comparison does not show."""

from __future__ import annotations

from wbc.files import slug
from wbc.report.document import Cell, Item, Section, Table, Text
from wbc.report.sections.settings import measured
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import PROVEN

FAILURES = "failures"


def failure_file(name: str, index: int) -> str:
    """Where the QP of a failure is saved, relative to the report."""
    return f"{FAILURES}/{slug(name)}-{index}.npz"


def failed(data: Data) -> list[tuple[str, int, str, str]]:
    """(set, index, solver, what happened) of every default solve without a certificate or a proof of no solution."""
    found = []
    for measure in data["measures"]:
        if measure["class"] != "default" or measure["mode"] != "cold":
            continue
        for i, word in enumerate(measure["status"]):
            if word != "SOLVED" and word not in PROVEN:
                ended, _, error = word.partition(" ")
                what = measure["lost"].get(str(i)) or f"{ended.replace('_', ' ').lower()} {error}".rstrip()
                found.append((measure["set"], i, measure["solver"], what))
    return found


def failures(data: Data) -> Section:
    """One row a problem that some solver did not solve with its default settings, and its file."""
    by_problem: dict[tuple[str, int], list[str]] = {}
    for name, i, solver, what in failed(data):
        by_problem.setdefault((name, i), []).append(f"{solver} ({what})")
    if not by_problem:
        return Section(
            "Failures", [Text("With its default settings every solver solved every problem that has a solution.")]
        )
    labels = {about["name"]: about["labels"] for about in data["sets"]}
    rows = [
        (name, labels[name][i], ", ".join(who), failure_file(name, i)) for (name, i), who in sorted(by_problem.items())
    ]
    text = (
        f"{len(rows)} problems that at least one solver did not solve with its default settings, cold. Each is saved: "
        "wbc explain FILE lists its active or conflicting rows, and wbc.QP.load(file) reads it."
    )
    return Section("Failures", [Text(text), Table(("set", "problem", "by", "file"), rows, "All failures", folded=True)])


def settings(data: Data) -> Section:
    """The exact call of each solver in each class; machine, load, versions, seed."""
    calls: list[list[Cell]] = [[s["name"], name, text] for s in data["solvers"] for name, text in s["calls"].items()]
    where = data["surroundings"]
    loads = {f"load at the {when} (1, 5, 15 min)": where[key] or "unknown" for when, key in
             (("start", "load"), ("end", "load_after"))}  # fmt: skip
    asked = {key.replace("_s", " [s]"): value for key, value in data["settings"].items()}
    about = ({"date": where["date"]}, where["machine"], loads, {"clock governor": where["governor"]}, asked)
    items: list[Item] = [
        measured(*about, caption="Where and how it was measured.", folded=False),
        Table(("solver", "requested", "settings"), calls, "Exact settings", folded=True),
        measured(where["versions"], caption="Versions"),
    ]
    return Section("Settings", items)


def limits(data: Data) -> Section:
    """Sentences, each true of this very comparison."""
    return Section("Limits of this comparison", [Text(sentence) for sentence in _limits(data)])


def _limits(data: Data) -> list[str]:
    settings = data["settings"]
    said = [
        f"Times are the least of {settings['rounds']} rounds on one machine, one thread, each solver in a process of "
        "its own, in turns; ratios differ less between machines than times do.",
        "A time is that of a whole solve of this library, with its checks and its certificate, which the column "
        "wrapper shows. For back ends that run through qpsolvers it includes building the problem at each call.",
        "The default settings are those that a name stands for in this library (docs/solvers.md), not the back "
        "end's own. An active-set solver (pdas, daqp, quadprog) is not faster at a looser tolerance: it stops at a "
        "vertex.",
        "One certificate judges all solvers: violations of rows in their own units, and the bound on the distance "
        "from the optimum. A solution that is not a hundred times finer than the tolerance is refined once with its "
        "active rows, whichever solver gave it, and the certificate judges the refined solution: accuracy and time are "
        "those of solver and refinement together. A solver with another stopping criterion may miss 1e-9 by a small "
        "factor.",
    ]
    once = [s["name"] for s in data["solvers"] if not s["repeatable"]]
    if once:
        said.append(f"{', '.join(once)} does not give the same bits twice; its residuals vary in their last digits.")
    kinds = {about["kind"] for about in data["sets"]}
    if "sequence" in kinds:
        said.append(
            "The QPs of a scenario were recorded in a closed loop with the default solver; another solver would meet "
            "slightly different ones. They are stretches of the run, not every tick."
        )
        said.append(
            "Every solver gets the QP in standard form here. In a controller the default solver works on the rows of "
            "the tasks and forms no Hessian, so its tick can be shorter than its solve here; the closed loop shows "
            "ticks."
        )
    if "files" in kinds:
        said.append("Problems from files are solved cold. The gain of a warm start is not measured.")
    if data["loops"]:
        said.append("Each closed loop ran once, so its tick times are single measurements.")
    if data["unread"]:
        said.append("Not read: " + "; ".join(f"{file} ({reason})" for file, reason in data["unread"].items()) + ".")
    said.append(
        f"A solve that takes longer than {settings['limit_s']:g} s is stopped and counts as lost. Solvers that are not "
        "installed are not compared. Nothing was measured on hardware."
    )
    return said
