"""Sweep: which runs there are. Run i depends on the settings, the seed and i alone, never on who does it or when."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.qp.solvers import by_name
from wbc.sim.disturbance import Disturbance
from wbc.sim.scenario import Scenario, UnknownParameter, absolute, check_consent, find
from wbc.sweep.draw import CODEC, Choice, Drawn, DrawnDisturbance, Range, about

#: A scenario's parameter of this name gets a number of its own in every run.
SEED = "seed"
_LARGEST_SEED = 2**31


@final
@dataclass(frozen=True)
class Trial:
    """One run: everything :meth:`wbc.sim.scenario.Scenario.run` needs, and the disturbances that join it."""

    run: int
    scenario: str
    parameters: Mapping[str, Any]
    solver: str
    settings: Mapping[str, Any]
    disturbances: Sequence[Disturbance] = ()


@final
@dataclass(frozen=True)
class Sweep:
    """Many runs of a scenario.

    Args:
        scenario: as ``wbc run`` takes it: a registered name, module:name or file.py:name.
        runs: how many.
        vary: what of the scenario's parameters is drawn, by name; ``fixed`` what is set for all.
        disturbances: what joins each run.
        solvers: drawn among these names; hierarchies likewise.
        seed: another seed, other runs.

    Raises:
        InvalidInput, UnknownName: a scenario, parameter, solver, hierarchy or plant that does not exist, or something
            in ``vary`` or ``disturbances`` that cannot be drawn.

    Example:
        >>> from wbc.sweep import Range, Sweep
        >>> sweep = Sweep("arm-reach", runs=100, vary={"step": Range(0.1, 0.3)}, fixed={"robot": "arm"})
        >>> trial = sweep.trial(7)
        >>> trial == sweep.trial(7), trial.parameters["robot"], 0.1 <= trial.parameters["step"] <= 0.3
        (True, 'arm', True)
    """

    scenario: str
    runs: int
    vary: Mapping[str, Drawn] = field(default_factory=dict)
    fixed: Mapping[str, Any] = field(default_factory=dict)
    disturbances: tuple[DrawnDisturbance, ...] = ()
    solvers: tuple[str, ...] = ("pdas",)
    hierarchies: tuple[str, ...] = ()
    plant: str | None = None
    duration: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "scenario", absolute(self.scenario))  # workers run in other folders
        if checks.number("runs", self.runs, low=1) != int(self.runs):
            raise InvalidInput(f"runs is {self.runs!r}; it must be a whole number")
        checks.seed("seed", self.seed)
        for name, value in self.vary.items():
            if not isinstance(value, Drawn):
                raise InvalidInput(f"vary[{name!r}] is {value!r}; it must be a Range or a Choice")
        for one in self.disturbances:
            if not isinstance(one, DrawnDisturbance):
                raise InvalidInput(f"disturbances holds {one!r}; each must be a RandomPush, RandomPayload, ...")
        scenario = find(self.scenario)
        for key in (*self.vary, *self.fixed):
            if key not in scenario.parameters:
                raise UnknownParameter(key, scenario.parameters)
            if key in self.vary and key in self.fixed:
                raise InvalidInput(f"parameter {key!r} is drawn and set; give one of --vary and --set, vary and fixed")
        for what, names in (("solvers", self.solvers), ("hierarchies", self.hierarchies or ("",))):
            with about(what):
                Choice(tuple(names))
        for solver in self.solvers:
            by_name(solver)
        for hierarchy in self.hierarchies or (None,):
            scenario.choose(plant=self.plant, hierarchy=hierarchy, duration=self.duration)

    def trial(self, run: int) -> Trial:
        """Run number ``run``, from 0.

        Raises:
            InvalidInput: there is no such run.
        """
        if not 0 <= run < self.runs:
            raise InvalidInput(f"there is no run {run}; they are 0 to {self.runs - 1}")
        return self._drawn(find(self.scenario), run)

    def trials(self, runs: Iterable[int]) -> Iterator[Trial]:
        """These runs, in this order; each is drawn when it is needed."""
        scenario = find(self.scenario)
        return (self._drawn(scenario, run) for run in runs)

    def _drawn(self, scenario: Scenario, run: int) -> Trial:
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, run]))
        parameters = {**scenario.parameters, **self.fixed}
        parameters |= {key: drawn.draw(rng) for key, drawn in self.vary.items()}
        if SEED in parameters and SEED not in (*self.vary, *self.fixed):
            parameters[SEED] = int(rng.integers(_LARGEST_SEED))
        hierarchy = Choice(self.hierarchies).draw(rng) if self.hierarchies else None
        settings = scenario.choose(plant=self.plant, hierarchy=hierarchy, duration=self.duration)
        solver = Choice(self.solvers).draw(rng)
        joining = [one.draw(rng, settings["duration"]) for one in self.disturbances]
        return Trial(run, self.scenario, parameters, solver, settings, joining)

    def to_json(self) -> dict[str, Any]:
        """The settings as JSON values, classes by name.

        Raises:
            InvalidInput: a value or a class of one's own that JSON cannot name.
        """
        return {one.name: CODEC.plain(getattr(self, one.name)) for one in fields(self)}

    @classmethod
    def from_json(cls, data: Mapping[str, Any], *, scenario: str | None = None) -> Self:
        """The sweep that :meth:`to_json` wrote. No class is looked up by a name from the file, and no file is executed.

        ``scenario`` is the user's consent to execute ``file.py:name`` or ``module:name``, where the file names one.

        Raises:
            InvalidInput: other fields, or a scenario outside the registered ones that ``scenario`` does not name.
        """
        names = {one.name for one in fields(cls)}
        if not isinstance(data, Mapping) or not set(data) <= names or not isinstance(data.get("scenario"), str):
            raise InvalidInput("the file does not hold the settings of a sweep")
        check_consent(data["scenario"], [] if scenario is None else [scenario])
        try:
            return cls(**{name: CODEC.whole(value) for name, value in data.items()})
        except (TypeError, AttributeError) as cause:
            raise InvalidInput(f"the file does not hold the settings of a sweep: {cause}") from cause

    def __str__(self) -> str:
        words = [f"{key} = {drawn}" for key, drawn in self.vary.items()]
        words += [f"{key} = {value}" for key, value in self.fixed.items()]
        words += [str(one) for one in self.disturbances]
        words += [f"solver {','.join(self.solvers)}"]
        words += [f"hierarchy {','.join(self.hierarchies)}"] if self.hierarchies else []
        words += [f"plant {self.plant}"] if self.plant else []
        words += [f"{self.duration:g} s"] if self.duration else []
        return ", ".join(words)


def read_variations(scenario: Scenario, texts: Iterable[str]) -> dict[str, Drawn]:
    """``key=LOW:HIGH`` for numbers, ``key=a,b,c`` for a choice, each value read as the scenario reads its own.

    Raises:
        InvalidInput: another form, or a range for a parameter that is no number.
        UnknownParameter: no such parameter.
    """
    found: dict[str, Drawn] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        if not equals:
            raise InvalidInput(f"--vary {text!r} must be key=LOW:HIGH or key=a,b,c")
        if key not in scenario.parameters:
            raise UnknownParameter(key, scenario.parameters)
        if key in found:
            raise InvalidInput(f"--vary {key} is given twice; give all its values, or one range")
        number = re.fullmatch(r"([^:,]+):([^:,]+)", values)
        if number is None:
            try:
                several = tuple(scenario.parse([f"{key}={value}"])[key] for value in values.split(","))
            except InvalidInput as refusal:
                raise InvalidInput(f"{refusal}; --vary takes {key}=LOW:HIGH or {key}=a,b,c") from None
            with about(f"--vary {key}"):
                found[key] = Choice(several)
            continue
        whole = isinstance(scenario.parameters[key], int) and not isinstance(scenario.parameters[key], bool)
        low, high = (checks.typed(f"--vary {key}", bound) for bound in number.groups())
        if isinstance(scenario.parameters[key], bool | tuple):
            raise InvalidInput(f"--vary {key} is no number: give its values, separated by commas")
        if isinstance(scenario.parameters[key], str):  # such as a force that may be "auto"
            scenario.parse([f"{key}={low}"])
        with about(f"--vary {key}"):
            found[key] = Range(low, high, whole)
    return found
