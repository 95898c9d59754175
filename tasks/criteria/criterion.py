"""Criterion: a number H(q) that a redundant robot should make large."""

from __future__ import annotations

from abc import abstractmethod

from wbc.models.model import RobotModel, RobotState
from wbc.stack.member import Member
from wbc.types import Vec


class Criterion(Member):
    """H(q) and its exact gradient ∇H = ∂H/∂q over the joints (nj,); a floating base is not a joint.

    Pure: the state alone decides, to the bit. ``name`` says what it is about; ``units`` are those of H.
    """

    name: str = ""
    units: str

    def prepare(self, model: RobotModel) -> None:
        """Called once on each plan's own copy: check arguments against the model."""

    @abstractmethod
    def value(self, state: RobotState) -> float:
        """H(q)."""

    @abstractmethod
    def gradient(self, state: RobotState) -> Vec:
        """∂H/∂q of each joint (nj,), in units of H per rad or m."""

    def __repr__(self) -> str:
        return self.name
