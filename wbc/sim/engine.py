"""The physics engine MuJoCo, imported without its pictures and without its log file, and its settings."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, final

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, SimulationError
from wbc.models.mujoco_import import import_mujoco
from wbc.sim.plant import whole

INTEGRATORS = ("implicitfast", "implicit", "euler")


def mujoco() -> Any:
    """The module ``mujoco``, without its pictures and its log file (:mod:`wbc.models.mujoco_import`).

    Raises:
        SimulationError: the package is not installed.
    """
    try:
        return import_mujoco()
    except ImportError as cause:
        raise SimulationError(f"the physics engine cannot be imported ({cause}); pip install mujoco") from cause


@final
@dataclass(frozen=True, kw_only=True)
class PhysicsSettings(metaclass=TellsArguments):
    """Settings of the physics engine; every other setting is MuJoCo's default. The friction cone is elliptic.

    ``solref`` (time constant [s], damping ratio) and ``solimp`` shape how soft contacts and joint stops are: with the
    default a 90 kg robot sinks a third of a millimetre. ``impratio`` makes friction stiffer than the normal direction:
    with less than 10 a standing foot creeps. ``joint_friction`` [N m, N] and ``joint_damping`` [N m s/rad, N s/m] are
    one number for every joint or "urdf"; they are 0 because the model that the controller knows has neither.
    ``armature`` [kg m², kg] is rotor inertia added to every joint. ``joint_stops``: whether joints stop at their
    position limits. ``solver_iterations`` at most for each step.

    Raises:
        InvalidInput: a setting out of range, by name.

    Example:
        >>> from wbc.sim.engine import PhysicsSettings
        >>> PhysicsSettings(impratio=100.0).impratio
        100.0
    """

    integrator: str = "implicitfast"
    impratio: float = 10.0
    solref: tuple[float, float] = (0.005, 1.0)
    solimp: tuple[float, float, float, float, float] = (0.95, 0.99, 0.001, 0.5, 2.0)
    joint_friction: float | str = 0.0
    joint_damping: float | str = 0.0
    armature: float = 0.0
    joint_stops: bool = True
    solver_iterations: int = 100

    def __post_init__(self) -> None:
        checks.one_of("integrator", self.integrator, INTEGRATORS)
        checks.number("impratio", self.impratio, low=0.0, strict=True)
        checks.number("armature", self.armature, low=0.0)
        whole("solver_iterations", self.solver_iterations)
        checks.truth("joint_stops", self.joint_stops)
        if (checks.array("solref", self.solref, (2,)) <= 0).any():
            raise InvalidInput(f"solref is {self.solref}; both must be > 0: (time constant [s], damping ratio)")
        checks.array("solimp", self.solimp, (5,))
        for name, value in (("joint_friction", self.joint_friction), ("joint_damping", self.joint_damping)):
            if not isinstance(value, str) or value != "urdf":
                checks.number(f'{name} (a number or "urdf")', value, low=0.0)

    def as_dict(self) -> dict[str, Any]:
        """Every setting by name, for a report."""
        return {**asdict(self), "cone": "elliptic"}
