"""Recording: the QPs that a scenario's controllers meet while they run."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from sys import stderr
from typing import TYPE_CHECKING, Any, final

from wbc.errors import InvalidInput
from wbc.qp.problem import QP
from wbc.report.solvers.problems import ProblemSet
from wbc.sim.joining import joined
from wbc.sim.scenario import Progress, Scenario, Settings, silent

if TYPE_CHECKING:
    from wbc.control.controller import Controller

#: Consecutive ticks that are kept together.
STRETCH = 40
#: Ticks of each size of a problem that grows.
GROWN = 6


@final
class QpRecorder:
    """Keeps about ``count`` QPs of every simulation it joins, in stretches of consecutive ticks spread over the run.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Posture
        >>> from wbc.report.solvers.recording import QpRecorder
        >>> from wbc.sim.joining import joined
        >>> from wbc.sim.plant import IntegratorPlant
        >>> from wbc.sim.simulate import simulate
        >>> robot, recorder = wbc.load("arm"), QpRecorder(count=80)
        >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel())
        >>> with joined(recorder):
        ...     _ = simulate(controller, IntegratorPlant(robot, level="velocity"), duration=0.3)
        >>> len(recorder.problems("a rest").qps), recorder.problems("a rest").stretches
        (80, [(0, 40), (40, 80)])
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._qps: list[QP] = []
        self._labels: list[str] = []
        self._starts: list[int] = []
        self._previous: tuple[Controller | None, int] = (None, -1)
        self._period: float | None = None

    def __call__(self, tick: int, ticks: int, controller: Controller) -> None:
        if not self._wanted(tick, ticks):
            return
        if self._previous != (controller, tick - 1):
            self._starts.append(len(self._qps))
        self._previous = (controller, tick)
        self._period = controller.dt
        self._qps.append(controller.qp)
        self._labels.append(f"t = {controller.state.t:.3f} s")

    def _wanted(self, tick: int, ticks: int) -> bool:
        """Whether a tick lies in one of the stretches: equally far apart, the first at the start, the "
        "last at the end."""
        if ticks <= self.count:
            return True
        stretches = max(1, self.count // STRETCH)
        length = min(STRETCH, self.count)
        last = ticks - length
        starts = [0] if stretches == 1 else [round(i * last / (stretches - 1)) for i in range(stretches)]
        return any(start <= tick < start + length for start in starts)

    def problems(self, name: str, source: str = "recorded") -> ProblemSet:
        """The recorded QPs.

        Raises:
            InvalidInput: nothing was.
        """
        if not self._qps:
            raise InvalidInput(
                f"{name} made no QP that could be recorded: it must run its controller by wbc.sim.simulate.simulate"
            )
        ends = [*self._starts[1:], len(self._qps)]
        stretches = list(zip(self._starts, ends, strict=True))
        return ProblemSet(name, "sequence", source, tuple(self._qps), self._labels, stretches, self._period)


def record(
    scenario: Scenario,
    parameters: Mapping[str, Any],
    settings: Mapping[str, Any],
    *,
    solver: str = "pdas",
    count: int = 200,
    progress: Progress = silent,
) -> ProblemSet:
    """Run a scenario and keep about ``count`` of its QPs.

    Raises:
        InvalidInput: the scenario never calls :func:`~wbc.sim.simulate.simulate`.
    """
    recorder = QpRecorder(count)
    with joined(recorder), redirect_stdout(stderr):
        scenario.run(parameters, Settings(**settings, solver=solver, progress=progress))
    chosen = ", ".join(f"{key} = {value}" for key, value in {**parameters, **settings}.items())
    return recorder.problems(scenario.name, f"recorded from {scenario.name} ({chosen}) run by {solver}")


def growing(scenario: Scenario) -> ProblemSet:
    """A scenario along its ``sizes``: the QPs of :data:`GROWN` consecutive ticks at each."""
    sets = []
    for size in scenario.sizes:
        setup, recorder = scenario.first_setup(scenario.complete_parameters({"size": size})), QpRecorder(GROWN)
        with joined(recorder):
            setup.run(duration=GROWN * setup.plant.dt, recorder=False)
        sets.append(recorder.problems(scenario.name))
    return ProblemSet(
        f"growth/{scenario.name}", "growth", scenario.summary, [qp for one in sets for qp in one.qps],
        [f"size {size}, {label}" for size, one in zip(scenario.sizes, sets, strict=True) for label in one.labels],
        [(GROWN * k, GROWN * (k + 1)) for k in range(len(sets))], sizes=scenario.sizes,
    )  # fmt: skip
