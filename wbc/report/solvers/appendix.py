"""What stands at the end: failures with their files, every setting, and what the comparison does not show."""

from __future__ import annotations

from wbc.report.document import Cell, Item, Section, Table, Text
from wbc.report.solvers.data import Data
from wbc.report.solvers.problems import slug

FAILURES = "failures"


def failure_file(name: str, index: int) -> str:
    """Where the QP of a failure is saved, relative to the report."""
    return f"{FAILURES}/{slug(name)}-{index}.npz"


def failed(data: Data) -> list[tuple[str, int, str, str]]:
    """(set, index, solver, what happened) of every solve with default settings that did not end in a certificate."""
    found = []
    for measure in data["measures"]:
        if measure["class"] != "default" or measure["mode"] != "cold":
            continue
        for i, word in enumerate(measure["status"]):
            if word != "SOLVED":
                what = measure["lost"].get(str(i)) or word.replace("_", " ").lower()
                found.append((measure["set"], i, measure["solver"], what))
    return found


def failures(data: Data) -> Section:
    """One row a problem that some solver did not solve with its default settings, and its file."""
    by_problem: dict[tuple[str, int], list[str]] = {}
    for name, i, solver, what in failed(data):
        by_problem.setdefault((name, i), []).append(f"{solver} ({what})")
    if not by_problem:
        return Section("Failures", [Text("Every solver solved every problem with its default settings.")])
    labels = {about["name"]: about["labels"] for about in data["sets"]}
    rows = [
        (name, labels[name][i], ", ".join(who), failure_file(name, i)) for (name, i), who in sorted(by_problem.items())
    ]
    text = (
        f"{len(rows)} problems that some solver did not answer with its default settings, cold. Each is saved: "
        "wbc explain FILE says what holds it, and wbc.QP.load(file) gives it back to the same bits."
    )
    return Section("Failures", [Text(text), Table(("set", "problem", "by", "file"), rows, "All of them", folded=True)])


def settings(data: Data) -> Section:
    """The exact call of each solver in each class; machine, load, versions, seed."""
    calls: list[list[Cell]] = [[s["name"], name, text] for s in data["solvers"] for name, text in s["calls"].items()]
    where = data["surroundings"]
    about: list[list[Cell]] = [["date", where["date"]]]
    about += [[key, str(value)] for key, value in where["machine"].items()]
    for when, loads in (("start", where["load"]), ("end", where["load_after"])):
        about += [[f"load at the {when} (1, 5, 15 min)", ", ".join(map(str, loads or ["unknown"]))]]
    about += [["clock governor", where["governor"]]]
    about += [[key.replace("_s", " [s]"), str(value)] for key, value in data["settings"].items()]
    versions: list[list[Cell]] = [[name, version] for name, version in where["versions"].items()]
    items: list[Item] = [
        Table(("", "value"), about, "Where and how it was measured."),
        Table(("solver", "asked for", "settings"), calls, "Exact settings", folded=True),
        Table(("package", "version"), versions, "Versions", folded=True),
    ]
    return Section("Settings", items)


def limits(data: Data) -> Section:
    """Sentences, each true of this very comparison."""
    return Section("Limits of this comparison", [Text(sentence) for sentence in _limits(data)])


def _limits(data: Data) -> list[str]:
    settings = data["settings"]
    said = [
        f"Times are the least of {settings['rounds']} rounds on one machine, one thread, each solver in a process of "
        "its own, in turns; ratios travel to other machines better than microseconds.",
        "A whole solve is timed as this library makes it: its checks and its certificate are in it, and are set "
        "apart as wrapper. For back ends that run through qpsolvers, building the problem anew at each call is in "
        "it too.",
        "The default settings are those that a name stands for in this library (docs/solvers.md), not the back "
        "end's own. Asking an active-set solver (pdas, daqp, quadprog) for less accuracy saves nothing: their steps "
        "end at a vertex.",
        "A solve counts as solved by one certificate for everybody: rows are judged in their own units, answers by "
        "how far they can be from the optimum. Methods that stop beside the optimum are refined once with the rows "
        "that they found active, and what is judged is the refined answer. A solver that stops by another measure "
        "may miss 1e-9 by a factor and be "
        "counted out.",
    ]
    once = [s["name"] for s in data["solvers"] if not s["repeatable"]]
    if once:
        said.append(f"{', '.join(once)} does not give the same bits twice; its residuals vary in their last digits.")
    kinds = {about["kind"] for about in data["sets"]}
    if "sequence" in kinds:
        said.append(
            "QPs of a scenario were recorded in a loop that the default solver closed; another solver's loop would "
            "meet slightly others. They are a sample of stretches, not every tick."
        )
        said.append(
            "Here every solver gets the QP in standard form. In a controller the default solver works on the plan's "
            "rows before any product is made, so its tick can be shorter than its solve here; the closed loop shows "
            "ticks."
        )
    if "files" in kinds:
        said.append("Problems from files are solved alone and cold; what a warm start would save them is not measured.")
    if data["loops"]:
        said.append("Each closed loop ran once; its tick times are single measurements, not least of several.")
    if data["unread"]:
        said.append("Not read: " + "; ".join(f"{file} ({reason})" for file, reason in data["unread"].items()) + ".")
    said.append(
        f"A solve that takes longer than {settings['limit_s']:g} s is stopped and counted as lost, whether it would "
        "have ended or not. Solvers that are not installed are not here; nothing was measured on hardware."
    )
    return said
