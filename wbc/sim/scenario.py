"""Scenario: robot, stack, plant, disturbances and a verdict under one name, and how scenarios are found.

A scenario is found by its registered name (:mod:`wbc.plugins`), or as ``module:name`` or ``file.py:name``, so that a
user's own file runs without packaging.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import operator
import sys
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, final

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, UnknownName, UnknownRobot, UnknownScenario, WbcError
from wbc.plugins import one_line, registered
from wbc.sim.trial import Parameters, Progress, Settings, Setup, Trial, silent, trials

if TYPE_CHECKING:
    import numpy as np

    from wbc.control.controller import Controller
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel

__all__ = [
    "RELATIONS", "Check", "Parameter", "Parameters", "Place", "Progress", "Scenario", "ScenarioResult", "Settings",
    "Setup", "Trial", "absolute", "check_consent", "failed_first", "find", "imported", "is_file", "scenarios",
    "scenarios_of", "silent", "trials",
]  # fmt: skip

Parameter = bool | int | float | str | tuple[float, ...]


@final
class Place(NamedTuple):
    """Where a demand is seen in a run: ``at`` [s] when it was first broken, or came nearest to it; the ``part`` of the
    robot, such as a joint or a contact; the ``plot`` of the report that shows it. Empty if unknown."""

    at: float | None = None
    part: str = ""
    plot: str = ""

    def __str__(self) -> str:
        when = "" if self.at is None else f"t = {self.at:.3f} s"
        return ", ".join(text for text in (when, self.part) if text)


NOWHERE = Place()

#: The relations of a value to its bound.
RELATIONS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, "=": operator.eq, ">=": operator.ge, ">": operator.gt,
}  # fmt: skip


@final
@dataclass(frozen=True)
class Check(metaclass=TellsArguments):
    """One line of a verdict: ``value relation bound``, both in ``unit``, and where it is seen in the run.

    Raises:
        InvalidInput: ``relation`` is none of <, <=, =, >=, >.

    Example:
        >>> from wbc.sim.scenario import Check
        >>> check = Check("slip of a foot", 0.0486, "<", 0.001, "m")
        >>> check.ok, check.sign
        (False, '<')
    """

    text: str
    value: float
    relation: str
    bound: float
    unit: str = ""
    place: Place = NOWHERE

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise InvalidInput(f"relation is {checks.shown(self.relation)}; it must be one of {', '.join(RELATIONS)}")

    @property
    def ok(self) -> bool:
        """True if the demand is met; a value that is not a number never meets it."""
        return bool(RELATIONS[self.relation](self.value, self.bound))

    @property
    def sign(self) -> str:
        """The relation as one writes it."""
        return {"<=": "≤", ">=": "≥"}.get(self.relation, self.relation)


def failed_first(checks: Iterable[Check]) -> list[Check]:
    """The checks of a verdict in the order in which they are read: those that failed by the time at which they did."""
    return sorted(checks, key=lambda check: (check.ok, 0.0 if check.ok else check.place.at or 0.0))


@final
@dataclass(frozen=True, eq=False)
class ScenarioResult:
    """The result of a scenario: the recorded run and its verdict.

    ``violations`` {kind: (worst, unit)}, 0 when nothing was broken; ``tracking`` {task: {"rms", "max"}} in the
    task's own unit (:mod:`wbc.report.measure` reads both from a run); ``figures`` whatever else the scenario
    measures, JSON values; ``robot`` is drawn in the report, and with it ``obstacles``.

    ``beside``: what other runs of the scenario came to, such as the one without what it is about, by name; ``called``
    names this one among them. Their robots are seen through in the report, their records lie beside this one.

    ``sections``, each a :class:`wbc.report.document.Section`, are what the scenario itself has to show. They stand
    behind the verdict in a report.
    """

    run: Run
    ok: bool
    violations: Mapping[str, tuple[float, str]]
    tracking: Mapping[str, Mapping[str, float]]
    verdict: Sequence[Check]
    figures: Mapping[str, Any] = field(default_factory=dict)
    robot: RobotModel | None = None
    obstacles: Sequence[Obstacle] = ()
    sections: Sequence[Any] = ()
    called: str = ""
    beside: Mapping[str, Run] = field(default_factory=dict)


class Scenario(metaclass=TellsArguments):
    """A model, a stack, a plant, disturbances and what counts as success, runnable by name.

    A scenario says three things. ``build(p)`` sets one run up. ``judge(trials, p)`` judges the result. ``cases(p)``
    names the runs, where there are several: each is a set of parameters, with and without something for instance.

    ``parameters`` names what ``--set key=value`` may change, with defaults that also give the type; ``plants`` and
    ``hierarchies`` what ``--plant`` and ``--hierarchy`` may be, the default first; ``duration`` is in seconds.
    ``robots`` names what the parameter ``robot`` may be, None for any, and ``knows`` what the scenario knows of them.
    ``wbc list`` shows scenarios by ``group``, with ``takes``, roughly how long a run and its report take [s].

    Every scenario can be timed (``wbc bench``, by default those of the group "workloads") and soaked (``wbc soak``, by
    default those of the group "soaks"). One with ``sizes`` has a parameter ``size`` that takes these values: along them
    ``wbc report scaling`` measures how the time of a tick grows.

    Example:
        >>> import wbc
        >>> from wbc.sim.plant import IntegratorPlant
        >>> from wbc.sim.scenario import Check, Scenario, Settings, Setup
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> from wbc.tasks.scenarios import judge
        >>> class Lift(Scenario):
        ...     name, summary = "lift", "an arm lifts its tool"
        ...     parameters = {"height": 0.1, "robot": "arm"}
        ...     def build(self, p):
        ...         robot = wbc.load(p["robot"])
        ...         target = robot.state().frame("tool").position + [0.0, 0.0, p["height"]]
        ...         stack = wbc.Stack([Position("tool", target=target)], subject_to=[JointVelocityLimits()])
        ...         return Setup(stack=stack, plant=IntegratorPlant(robot, level="velocity"), level=wbc.VelocityLevel())
        ...     def judge(self, trials, p):
        ...         (trial,) = trials
        ...         left = float(trial.error("Position")[-1])
        ...         return judge.verdict(trial, [Check("way that is left", left, "<", 1e-3, "m")])
        >>> lift = Lift()
        >>> lift.parse(["height=0.05"])
        {'height': 0.05, 'robot': 'arm'}
        >>> lift.run(lift.parse(["height=0.05"]), Settings("integrator", "weighted", duration=1.0)).ok
        True
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, Parameter]] = {}
    plants: ClassVar[Sequence[str]] = ("integrator",)
    hierarchies: ClassVar[Sequence[str]] = ("weighted",)
    duration: ClassVar[float] = 4.0
    group: ClassVar[str] = ""
    takes: ClassVar[float | None] = None
    robots: ClassVar[Collection[str] | None] = None
    knows: ClassVar[str] = "how these stand"
    sizes: ClassVar[Sequence[int]] = ()

    def cases(self, p: Parameters) -> Mapping[str, Mapping[str, Any]]:
        """The runs by name, in the order in which they are done, each with what it adds to the parameters."""
        return {"": {}}

    def build(self, p: Parameters) -> Setup:
        """One run, ready to be simulated. A scenario with a loop of its own has no cases, and does without.

        Raises:
            WbcError: an unknown frame, or a parameter without meaning here.
        """
        raise InvalidInput(f"the scenario {self.name!r} has no build(p), so it cannot simulate a case")

    def stir(self, controller: Controller, rng: np.random.Generator) -> None:
        """Assign targets and weights that make sense, reachable or not: what a soak does now and then."""

    @abstractmethod
    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        """Judge the runs. Each is simulated when it is taken from ``trials``, in the order of the cases."""

    @final
    def run(
        self, parameters: Mapping[str, Any], settings: Settings, *, simulated: Callable[[Trial], object] | None = None
    ) -> ScenarioResult:
        """Build and simulate each case, and judge. ``parameters`` is complete: the defaults and what the user set.
        ``simulated`` is called with each trial before it is judged.

        Raises:
            WbcError: an unknown frame or solver, or a setting without meaning here; before the first tick.
        """
        p = Parameters(parameters, settings)
        done = self.simulated(self.cases(p), p)
        result = self.judge(done if simulated is None else _shown(done, simulated), p)
        kind = "a ScenarioResult, such as wbc.tasks.scenarios.judge.verdict makes"
        return checks.instance(f"what judge of the scenario {self.name!r} returns", result, ScenarioResult, kind)

    @final
    def simulated(self, cases: Mapping[str, Mapping[str, Any]], p: Parameters) -> Iterator[Trial]:
        """The trial of each case, simulated when it is taken."""
        meta, progress = {"scenario": self.name, "parameters": dict(p)}, p.settings.progress
        several = trials(progress, cases.items()) if len(cases) > 1 else ((one, progress) for one in cases.items())
        for (name, case), step in several:
            step(0.0, name)
            setup = self._built(p, case)
            chosen = p.settings
            yield setup.run(name, duration=chosen.duration, solver=chosen.solver, progress=step, meta=meta)

    @final
    def complete_parameters(
        self, parameters: Mapping[str, Any] | None = None, *, plant: str | None = None, hierarchy: str | None = None,
        duration: float | None = None, solver: str = "pdas", progress: Progress = silent,
    ) -> Parameters:  # fmt: skip
        """All parameters and settings of a run; the scenario's own where none is given.

        Raises:
            WbcError: what :meth:`choose` raises.
        """
        chosen = self.choose(plant=plant, hierarchy=hierarchy, duration=duration)
        settings = Settings(**chosen, solver=solver, progress=progress)
        return Parameters({**self.parameters, **(parameters or {})}, settings)

    @final
    def first_setup(self, p: Parameters) -> Setup:
        """The first of its cases, ready to be simulated.

        Raises:
            WbcError: what :meth:`build` raises.
        """
        return self._built(p, next(iter(self.cases(p).values()), {}))

    def _built(self, p: Parameters, case: Mapping[str, Any]) -> Setup:
        setup = self.build(Parameters({**p, **case}, p.settings))
        return checks.instance(f"what build of the scenario {self.name!r} returns", setup, Setup, "a Setup")

    @final
    def parse(self, settings: Iterable[str]) -> dict[str, Parameter]:
        """The parameters with ``key=value`` texts applied, each read as its default is.

        Raises:
            InvalidInput: no "=", or a value of another type.
            UnknownParameter: no such key.
            UnknownRobot: a robot that the scenario does not know.
        """
        result = dict(self.parameters)
        for setting in settings:
            key, equals, text = setting.partition("=")
            if not equals:
                raise InvalidInput(f"--set {setting!r} must be key=value; keys: {', '.join(self.parameters) or 'none'}")
            if key not in self.parameters:
                raise UnknownParameter(key, self.parameters)
            result[key] = _read(key, text, self.parameters[key])
        if self.robots is not None and result["robot"] not in self.robots:
            raise UnknownRobot(result["robot"], self.robots, f"{self.name} knows {self.knows}")
        return result

    @final
    def choose(self, *, plant: str | None, hierarchy: str | None, duration: float | None) -> dict[str, Any]:
        """Fields of :class:`Settings`, with the scenario's defaults where nothing is given.

        Raises:
            InvalidInput: a duration that is not positive.
            UnknownPlant, UnknownHierarchy: not one of this scenario's.
        """
        if plant is not None and plant not in self.plants:
            raise UnknownPlant(plant, self.plants, f"the plants of the scenario {self.name!r}")
        if hierarchy is not None and hierarchy not in self.hierarchies:
            raise UnknownHierarchy(hierarchy, self.hierarchies, f"the hierarchies of the scenario {self.name!r}")
        return {
            "plant": plant or self.plants[0],
            "hierarchy": hierarchy or self.hierarchies[0],
            "duration": checks.number("duration", self.duration if duration is None else duration, low=0, strict=True),
        }


def _shown(done: Iterator[Trial], simulated: Callable[[Trial], object]) -> Iterator[Trial]:
    """The trials, each shown to ``simulated`` first. None is kept while the next is simulated."""
    for trial in done:
        simulated(trial)
        yield trial
        del trial


class UnknownParameter(UnknownName):
    """No such parameter of the scenario."""

    kind = "parameter"


class UnknownPlant(UnknownName):
    """The scenario does not run on such a plant."""

    kind = "plant"


class UnknownHierarchy(UnknownName):
    """The scenario does not know such a hierarchy."""

    kind = "hierarchy"


def scenarios(group: str | None = None) -> dict[str, Scenario]:
    """Every registered scenario by name, or those of a group; a plugin that cannot be loaded is left out with a
    warning."""
    found = registered(Scenario)
    return {name: scenario for name, scenario in found.items() if group in (None, scenario.group)}


def is_file(text: str) -> bool:
    """Whether a file is named, and no scenario in it."""
    return text.endswith(".py") and ":" not in text


def scenarios_of(file: str) -> dict[str, Scenario]:
    """The scenarios of a file by what :func:`find` takes: ``file.py:name``.

    Raises:
        InvalidInput: the file cannot be imported, or has no scenario.
    """
    module = imported(file)
    found = {
        f"{file}:{name}": scenario
        for name in _members_in(module) if (scenario := _scenario(vars(module)[name]))
    }  # fmt: skip
    if not found:
        raise InvalidInput(f"{file!r} has no scenario: no subclass of wbc.sim.scenario.Scenario")
    return found


def find(text: str) -> Scenario:
    """The scenario that is registered by that name; or ``module:name``, or ``file.py:name``.

    Raises:
        UnknownScenario: no such name.
        InvalidInput: the module or file cannot be imported, the name in it is no scenario, or a file without a name.
    """
    place, colon, name = text.rpartition(":")
    if is_file(text):
        raise InvalidInput(f"{text!r} is a file; name a scenario in it: {', '.join(scenarios_of(text))}")
    if not colon:
        known = scenarios()
        if text not in known:
            raise UnknownScenario(text, known, "or give module:name or file.py:name")
        return known[text]
    module = imported(place)
    if not hasattr(module, name):
        raise UnknownScenario(name, _members_in(module), f"in {place}")
    value = getattr(module, name)
    found = _scenario(value)
    if found is None:
        kind = "class" if inspect.isclass(value) else type(value).__name__
        wanted = f"{Scenario.__module__}.{Scenario.__name__} with a name, or a class that makes one without arguments"
        raise InvalidInput(f"{text} is a {kind}, not a {wanted}")
    return found


def check_consent(stored: str, given: Iterable[object]) -> None:
    """Refuse to execute code that a file names, unless the user names it too.

    Raises:
        InvalidInput: ``stored`` is ``file.py:name`` or ``module:name``, and none of ``given``.
    """
    if ":" in stored and absolute(stored) not in [absolute(str(one)) for one in given]:
        raise InvalidInput(
            f"the file says that its scenario is the Python code {stored}; name that scenario in the command to run it"
        )


def absolute(text: str) -> str:
    """``file.py:name`` with the whole path of the file, for use from another folder; other names unchanged."""
    place, colon, name = text.rpartition(":")
    return f"{Path(place).resolve()}:{name}" if colon and place.endswith(".py") else text


def _members_in(module: Any) -> list[str]:
    """Names of the scenarios that a module defines; of a class and its instances the instances."""
    own = module.__name__
    defined = {key: value for key, value in vars(module).items() if _scenario(value) is not None}
    made = {type(value) for value in defined.values()}
    return [key for key, value in defined.items() if getattr(value, "__module__", own) == own and value not in made]


def _scenario(value: Any) -> Scenario | None:
    """``value`` where it is a scenario with a name, which may be given as its class."""
    if inspect.isclass(value) and issubclass(value, Scenario):
        try:
            value = value()
        except TypeError:  # without judge, or made with arguments: its instances are scenarios
            return None
    return value if isinstance(value, Scenario) and hasattr(value, "name") else None


def imported(place: str) -> Any:
    """Import ``package.module`` from the working folder, or ``some/file.py`` and what it imports from its folder."""
    path = Path(place)
    is_file = path.suffix == ".py"
    if is_file and not path.is_file():
        raise InvalidInput(f"there is no file {place!r}; a scenario is a registered name, module:name or file.py:name")
    folder = str((path.parent if is_file else Path.cwd()).resolve())
    if folder not in sys.path:
        # Behind everything else for a file: a json.py beside it must not become the json of workers, who inherit it.
        sys.path.insert(len(sys.path) if is_file else 0, folder)
    try:
        return _execute(path) if is_file else importlib.import_module(place)
    except WbcError:
        raise
    except (Exception, SystemExit) as cause:
        raise InvalidInput(f"{place!r} cannot be imported: {one_line(cause)}") from cause


def _execute(path: Path) -> Any:
    name = f"wbc_scenario_{path.stem}"  # never the name of a module that somebody else imports
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None, "a .py file always has a loader"
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


_YES, _NO = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


def _read(key: str, text: str, default: Parameter) -> Parameter:
    """``text`` as the type of ``default``."""
    if isinstance(default, bool):
        if text.lower() not in (*_YES, *_NO):
            raise InvalidInput(f"parameter {key!r} is {text!r}; it must be one of {', '.join((*_YES, *_NO))}")
        return text.lower() in _YES
    if isinstance(default, str):
        return text
    if isinstance(default, int):
        try:
            return int(text)
        except ValueError:
            raise InvalidInput(f"parameter {key!r} is {text!r}; it must be a whole number such as {default}") from None
    if isinstance(default, float):
        return checks.typed(f"parameter {key!r}", text)
    kinds = "a truth value, number, text or tuple of numbers"
    checks.instance(f"the default of parameter {key!r}", default, Sequence, kinds)
    parts = text.split(",")
    if len(parts) != len(default):
        raise InvalidInput(f"parameter {key!r} must have shape ({len(default)},), not ({len(parts)},)")
    return tuple(checks.typed(f"parameter {key!r}[{i}]", part) for i, part in enumerate(parts))
