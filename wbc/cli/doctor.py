"""``wbc doctor``: what is installed, whether it works, and how to install what is not."""

from __future__ import annotations

import json
import re
import time
import warnings
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from typing import NamedTuple

import numpy as np
import typer
from rich.text import Text

from wbc.cli.console import NO, on_stderr, one_sentence, progress, say, table
from wbc.cli.options import AsJson
from wbc.errors import WbcError
from wbc.models.model import RobotModel
from wbc.qp.problem import QP
from wbc.qp.solver import Solver

DISTRIBUTION = "wbc-qp"
PROBLEMS = 10


class Finding(NamedTuple):
    """One line: what was looked at, how it is, and whether that is as it should be."""

    what: str
    state: str
    good: bool = True


@one_sentence
def doctor(*, as_json: AsJson = False) -> None:
    """Look at python, packages, solvers, extras, threads and robots. Exit code 1: something installed does not work."""
    bad, all_findings = 0, {}
    parts = (
        ("Python and packages", packages),
        ("Extras", extras),
        ("Threads", threads),
        ("Solvers", solvers),
        ("Robots", robots),
    )
    for title, look in parts:
        with on_stderr(), progress(title) as step:
            findings = []
            for k, finding in enumerate(look()):
                findings.append(finding)
                step(1.0 - 0.9**k, finding.what)
        made = table(title, "", "")
        for finding in findings:
            made.add_row(Text(finding.what), Text(finding.state, style="" if finding.good else "bold red"))
        if not as_json:
            say(made, "")
        bad += sum(not finding.good for finding in findings)
        all_findings[title] = [finding._asdict() for finding in findings]
    if as_json:
        print(json.dumps({"ok": not bad, "findings": all_findings}, ensure_ascii=False))
    else:
        say("everything that is installed works" if not bad else f"{bad} not as it should be, in red above")
    raise typer.Exit(NO if bad else 0)


def packages() -> Iterator[Finding]:
    """Versions of what decides numbers and times."""
    from wbc.sim.provenance import machine, versions

    for name, found in versions().items():
        yield Finding(name, found)
    for name, here in machine().items():
        yield Finding(name, str(here))


def extras() -> Iterator[Finding]:
    """Each extra of this distribution: complete, or how to install it."""
    try:
        wanted = requires(DISTRIBUTION) or []
    except PackageNotFoundError:
        yield Finding(
            DISTRIBUTION, "not installed, only imported: scenarios have no names; pip install -e .", good=False
        )
        return
    needs: dict[str, list[str]] = {}
    for line in wanted:
        match = re.match(r"([A-Za-z0-9._-]+).*extra\s*==\s*['\"]([\w-]+)['\"]", line)
        if match and match[1] != DISTRIBUTION and match[2] != "all":
            needs.setdefault(match[2], []).append(match[1])
    for extra, names in needs.items():
        missing = [name for name in names if not _installed(name)]
        hint = f"without {', '.join(missing)}; from a clone of wbc: pip install '.[{extra}]'"
        yield Finding(extra, hint if missing else ", ".join(names))


def threads() -> Iterator[Finding]:
    """How many threads each BLAS would use outside a simulation, which sets it to one."""
    from threadpoolctl import threadpool_info

    for pool in threadpool_info():
        name = f"{pool['internal_api']} ({pool.get('version') or 'unknown version'})"
        yield Finding(name, f"threads: {pool['num_threads']}; a simulation uses 1")


def solvers() -> Iterator[Finding]:
    """Each solver: how many of ten small problems it answers with a valid certificate."""
    from wbc.qp.solvers import SOLVERS

    problems = [problem(seed) for seed in range(PROBLEMS)]
    for solver in SOLVERS:
        yield checked(solver, problems) if solver.available() else Finding(solver.name, f"pip install {solver.package}")


def checked(solver: Solver, problems: list[QP]) -> Finding:
    """Solve the problems; the certificate judges, not the solver."""
    certified, start = 0, time.perf_counter()
    try:
        for qp in problems:
            certified += solver.solve(qp).status.ok
    except WbcError as error:
        return Finding(solver.name, str(error), good=False)
    each = 1e3 * (time.perf_counter() - start) / len(problems)
    text = f"{certified} of {len(problems)} certified, {each:.2f} ms each, cold"
    return Finding(solver.name, text + (", offline only" if solver.offline else ""), certified == len(problems))


def problem(seed: int) -> QP:
    """A strictly convex QP of 12 variables, 3 equalities, 8 two-sided rows and bounds, some of them active."""
    rng = np.random.default_rng(seed)
    n, root = 12, rng.normal(size=(12, 12))
    A, C, inside = rng.normal(size=(3, n)), rng.normal(size=(8, n)), rng.uniform(-0.5, 0.5, n)
    return QP(
        root @ root.T + 0.1 * np.eye(n), 10.0 * rng.normal(size=n), A=A, b=A @ inside,
        C=C, cl=C @ inside - 0.5, cu=C @ inside + 0.5, lb=np.full(n, -1.0), ub=np.full(n, 1.0),
    )  # fmt: skip


def robots() -> Iterator[Finding]:
    """Each robot that can be loaded: its size, and the limits of zero that a task would refuse."""
    from wbc.errors import ModelError
    from wbc.models import load
    from wbc.models.catalogue import EXAMPLES, OWN, example_robots

    names = list(OWN)
    try:
        example_robots()
        names += EXAMPLES
    except ModelError as missing:
        yield Finding("example-robot-data", str(missing))
    for name in names:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                robot = load(name)
        except WbcError as error:
            yield Finding(name, str(error), good=False)
            continue
        yield Finding(name, "; ".join([f"{robot.nj} joints, {robot.mass:.1f} kg", *senseless_limits(robot)]))


def senseless_limits(robot: RobotModel) -> list[str]:
    """Limits of a model that a constraint which uses them refuses: 0, negative, NaN or crossed, by joint name."""
    limits = robot.limits
    found = []
    for kind, good in (
        ("velocity", limits.v_max > 0.0), ("torque", limits.tau_max > 0.0), ("position", limits.q_min <= limits.q_max),
    ):  # fmt: skip
        names = [joint for joint, fine in zip(robot.joint_names, good, strict=True) if not fine]
        if names:
            more = f" and {len(names) - 3} more" if len(names) > 3 else ""
            found.append(f"no sensible {kind} limit on {', '.join(names[:3])}{more}")
    return found


def _installed(distribution: str) -> bool:
    try:
        version(distribution)
    except PackageNotFoundError:
        return False
    return True
