"""Response: how the joints of a robot answer small motions, measured, and what its model says they do.

Near where a robot with a fixed base rests at q, with torques g there, small motions δq(t) (n,) take the torques

    τ(t) = g + G δq + M δq̈        G = ∂g/∂q

with the inertia matrix M (n, n). Times a function φ(t) that begins and ends flat at 0, and integrated (twice by parts)

    ∫ φ τ = G ∫ φ δq + M ∫ φ̈ δq        or        T = G Q + M A

which holds for whatever motion it was, asks for no acceleration, and averages noise. Each motion is a column of T, Q
and A. Motors add what descriptions leave out: inertia of the rotor J ≥ 0, damping d ≥ 0 and dry friction F ≥ 0,

    T = G Q + M A + J A + d V + F S        V = −∫ φ̇ δq        S = ∫ φ sign(δq̇)

which are fitted to each joint. The frequency of a motion alone does not tell d from F: three times that frequency, at
which friction goes on and damping does not, is weighted as well. A joint that friction holds may take any torque up to
F from outside of which its motor feels nothing: only what is beyond that counts (2/π F of a weighted torque, as
∫ φ |cos| ≤ 2/π ∫ |φ|). What J, d and F explain shows no mistake: it is then said to be unproven.
A map between joints and motors that is wrong gives q, τ and these of a robot that this one is not. A **mistake** says
how: joint i of the map is joint π(i) of the robot, and

    q_π = (q_i − o) / (s r)        τ_π = s f τ_i        s = ±1, ratio r, offset o

with f = r for a gear, and f = 1 for a unit, which torques do not have. Torques that are read wrong have s r = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any, final

import numpy as np
import pinocchio
from scipy.optimize import nnls

from wbc.types import Index, Mat, Vec

#: What measured torques may differ from the model's by: so much [N m], and this share.
_DYNAMIC, _STATIC, _SHARE = 0.02, 0.1, 0.12
#: A mistake must explain so much more of what was seen than the map as it is does, in units of the cost. Of 30
#: sound robots with masses 5 % off, none explained more than 0.8.
CONVINCING = 5.0
#: Gears that are tried first.
_RATIOS = 0.015, 0.1, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 10.0, 60.0
#: By the unit of a joint: what it does; how many of another unit make one; the names of both.
_UNITS = {"rad": ("turns", 180.0 / np.pi, "degrees", "radians"), "m": ("slides", 1e3, "millimetres", "metres")}
#: Of so many limbs that are alike, several pairs may be exchanged at once.
_FEW = 6
#: A joint stands so far beyond its limits at most [rad, m].
_BEYOND = 0.3
#: Velocities are differences over so long [s]; below this share of the largest one they may be noise.
_APART, _STILL = 0.01, 0.03


@final
@dataclass(frozen=True, eq=False)
class Response:
    """What was measured, joints in the order of the map: at rest q and tau (n,); Q, V, A, S and T (n, 4 n), as above:
    columns j and n + j at the frequency at which joint j was moved, 2 n + j and 3 n + j at three times that."""

    q: Vec
    tau: Vec
    Q: Mat
    V: Mat
    A: Mat
    S: Mat
    T: Mat


class Weights:
    """φ, φ̇ and φ̈ (4, N) of N states that are ``period`` [s] apart: cosine and sine of ``frequency`` [Hz], and of three
    times that, in a ``window`` (N,) that is flat at both ends and whose sum is 1."""

    def __init__(self, count: int, period: float, frequency: float) -> None:
        t = period * np.arange(count)
        phases = 2.0 * np.pi * frequency * np.array([[1.0], [3.0]]) * t
        self.window = np.sin(np.pi * t / (count * period)) ** 2 * 2.0 / count
        self.phi = self.window * np.array([np.cos(phases), np.sin(phases)]).swapaxes(0, 1).reshape(4, count)
        self.first, self.second = np.gradient(self.phi, period, axis=1), np.zeros_like(self.phi)
        self.second[:, 1:-1] = np.diff(self.phi, 2, axis=1) / period**2
        self._half = max(1, round(0.5 * _APART / period))

    def signs(self, q: Vec) -> Vec:
        """∫ φ sign(q̇) (4,) of positions (N,)."""
        ends = np.pad(q, self._half, "edge")
        change = ends[2 * self._half :] - ends[: -2 * self._half]
        signs: Vec = self.phi @ np.clip(change / (_STILL * np.abs(change).max() + 1e-12), -1.0, 1.0)
        return signs


@final
@dataclass(frozen=True, eq=False)
class Mistake:
    """A wrong map, and the ``sentence`` that names it; ``kind``: order, sign, gear, unit, offset or torque."""

    kind: str
    sentence: str
    joints: tuple[str, ...]
    order: Index
    scale: Vec
    offset: Vec
    force: Vec

    def shows(self, moved: str, read: str, way: float, names: Sequence[str]) -> bool:
        """Whether a joint that is ``moved`` towards larger angles is read as ``read`` that moves by ``way``."""
        i = names.index(read)
        return names[int(self.order[i])] == moved and bool(self.scale[i] * way > 0.0)

    def parts(self, other: Mistake, names: Sequence[str]) -> str:
        """A joint whose motion by hand distinguishes this mistake from another; "" where none does."""
        apart = (self.order != other.order) | (np.sign(self.scale) != np.sign(other.scale))
        return names[int(self.order[int(apart.argmax())])] if apart.any() else ""

    def applied(self, seen: Response) -> Response:
        """What the robot's own joints did, if this is the mistake."""
        n = len(self.order)
        inverse = np.empty(n, dtype=np.intp)
        inverse[self.order] = np.arange(n)
        scale = self.scale[inverse]
        q = ((seen.q - self.offset) / self.scale)[inverse]
        Q, V, A = (one[inverse] / scale[:, None] for one in (seen.Q, seen.V, seen.A))
        S, force = np.sign(scale)[:, None] * seen.S[inverse], self.force[inverse]
        return Response(q, seen.tau[inverse] * force, Q, V, A, S, seen.T[inverse] * force[:, None])


@final
class Expected:
    """What the model of a robot says, its base at ``attitude`` (3, 3) in the world."""

    def __init__(self, robot: Any, attitude: Mat) -> None:
        self.names: tuple[str, ...] = robot.joint_names
        self.units: tuple[str, ...] = robot.joint_units
        self._limits = robot.limits
        self._model = robot.pinocchio.copy()
        self._model.gravity = pinocchio.Motion(attitude.T @ robot.gravity, np.zeros(3))
        self._data = self._model.createData()

    def at(self, q: Vec) -> tuple[Vec, Mat, Mat]:
        """g (n,), G and M (n, n)."""
        model, data = self._model, self._data
        stiffness = np.array(pinocchio.computeGeneralizedGravityDerivatives(model, data, q))
        gravity = np.array(pinocchio.computeGeneralizedGravity(model, data, q))
        inertia = np.array(pinocchio.crba(model, data, q))
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        return gravity, stiffness, inertia + np.diag(model.armature)

    def cost(self, seen: Response) -> float:
        """How far what was seen is from the model: Σ log(1 + r⁴) over all torques, r = 1 at what they may differ by.
        Many small r, as of masses that are somewhat off, count for little."""
        dynamic, static = self.errors(seen)
        return float(np.log1p(dynamic**4).sum() + np.log1p(static**4).sum())

    def errors(self, seen: Response) -> tuple[Mat, Vec]:
        """r of the torques in motion (n, 2 n) and at rest (n,)."""
        n = len(seen.q)
        ideal, friction, allowed = self._fitted(seen)
        off, rest = (seen.T - ideal.T)[:, : 2 * n], seen.tau - ideal.tau
        size = np.hypot(off[:, :n], off[:, n:])
        off = off * np.tile(_beyond(size, 2.0 / np.pi * friction[:, None]), 2)
        rest = rest * _beyond(np.abs(rest), friction)
        return off / allowed[:, : 2 * n], rest / (_STATIC + _SHARE * np.abs(ideal.tau))

    def ideal(self, seen: Response) -> Response:
        """What would have been seen with this model, these motions and motors, and a sound map."""
        return self._fitted(seen)[0]

    def _fitted(self, seen: Response) -> tuple[Response, Vec, Mat]:
        """What is expected with the J, d and F that fit best; F (n,); and what torques T may differ by (n, 4 n)."""
        gravity, G, M = self.at(seen.q)
        T = G @ seen.Q + M @ seen.A
        allowed = _DYNAMIC + _SHARE * (np.abs(G) @ np.abs(seen.Q) + np.abs(M) @ np.abs(seen.A))
        friction = np.zeros(len(gravity))
        for i, by in enumerate(allowed):
            added = np.array([seen.A[i], seen.V[i], seen.S[i]])
            sizes = nnls((added / by).T, (seen.T[i] - T[i]) / by)[0]
            T[i] += sizes @ added
            friction[i] = sizes[2]
        return replace(seen, tau=gravity, T=T), friction, allowed

    def outside(self, q: Vec) -> list[Mistake]:
        """Joints that are read where they cannot be; a whole turn changes no torque."""
        least, most, candidates = self._limits.q_min, self._limits.q_max, Candidates(self)
        found = []
        for i in np.flatnonzero(np.maximum(q - most, least - q) > _BEYOND):
            off = q[i] - np.clip(q[i], least[i], most[i])
            unit = self.units[i]
            nearest = q[i] - np.sign(off) * 2.0 * np.pi * np.ceil(abs(off) / (2.0 * np.pi))
            is_turned = unit == "rad" and least[i] - _BEYOND <= nearest <= most[i] + _BEYOND
            why = "it is off by whole turns" if is_turned else "its offset or its unit is wrong"
            limits = f"{least[i]:.3g} and {most[i]:.3g} {unit}"
            text = f"{self.names[i]} is read at {q[i]:.3g} {unit}, beyond its limits {limits}: {why}"
            found.append(candidates.made("offset", text, [int(i)]))
        return found

    def limbs(self) -> list[list[int]]:
        """Joints that follow one another from the base, or from where chains part."""
        parents, found = self._model.parents, dict[int, list[int]]()
        children = [sum(parents[k] == joint for k in range(1, self._model.njoints)) for joint in range(len(parents))]
        ends = dict[int, int]()
        for joint in range(1, self._model.njoints):
            parent = parents[joint]
            start = ends[parent] if parent and children[parent] == 1 else joint
            ends[joint] = start
            found.setdefault(start, []).append(self._model.idx_vs[joint])
        return list(found.values())


class Candidates:
    """The mistakes that are looked for, on the joints of one robot."""

    def __init__(self, expected: Expected) -> None:
        self.names, self.n, self._units = expected.names, len(expected.names), expected.units
        self._limbs = expected.limbs()

    def made(self, kind: str, sentence: str, joints: Sequence[int], **how: Any) -> Mistake:
        """A mistake; ``order``, ``scale`` and ``offset`` by joint."""
        order, scale, offset = np.arange(self.n), np.ones(self.n), np.zeros(self.n)
        for name, array in (("order", order), ("scale", scale), ("offset", offset)):
            for joint, value in how.get(name, {}).items():
                array[joint] = value
        force = np.sign(scale) if kind == "unit" else scale
        return Mistake(kind, sentence, tuple(self.names[j] for j in joints), order, scale, offset, force)

    def exchanged(self) -> list[Mistake]:
        """Two joints, for each other."""
        names = self.names
        return [
            self.made("order", f"{names[i]} and {names[j]} are exchanged", [i, j], order={i: j, j: i})
            for i in range(self.n)
            for j in range(i + 1, self.n)
        ]

    def turned(self) -> list[Mistake]:
        """One joint, or all, count the other way round."""
        each = [(f"the sign of {name} is", [i]) for i, name in enumerate(self.names)]
        return [
            self.made("sign", f"{whose} wrong", joints, scale=dict.fromkeys(joints, -1))
            for whose, joints in [*each, ("the signs of all joints are", [*range(self.n)])]
        ]

    def _sets(self) -> list[tuple[str, list[int]]]:
        """Each joint, and all, with what they are called."""
        return [*((name, [i]) for i, name in enumerate(self.names)), ("every joint", [*range(self.n)])]

    def limbs(self) -> list[Mistake]:
        """Limbs for each other, and joints of a limb, or of all of its kind, in another order."""
        found = []
        kinds: dict[int, list[list[int]]] = {}
        for limb in self._limbs:
            kinds.setdefault(len(limb), []).append(limb)
        for size, alike in kinds.items():
            for order in _pairings(len(alike)):
                moved = {
                    a: b for k, other in enumerate(order) for a, b in zip(alike[k], alike[other], strict=True) if a != b
                }
                text = " and ".join(
                    f"{self._name(alike[k])} with {self._name(alike[o])}" for k, o in enumerate(order) if o > k
                )
                found.append(self.made("order", f"limbs are exchanged: {text}", [*moved], order=moved))
            groups = [[limb] for limb in alike] + ([alike] if len(alike) > 1 else [])
            for order, group in product(_orders(size), groups):
                apart = [(k, o) for k, o in enumerate(order) if k != o]
                moved = {limb[k]: limb[o] for limb in group for k, o in apart}
                whose = "each limb" if group is alike else f"the limb of {self._name(group[0])}"
                text = ", ".join(f"{self.names[group[0][k]]} is {self.names[group[0][o]]}" for k, o in apart)
                sentence = f"the joints of {whose} are in another order: {text}"
                found.append(self.made("order", sentence, [*moved], order=moved))
        return found

    def _name(self, limb: list[int]) -> str:
        return self.names[limb[0]]

    def geared(self, seen: Response, expected: Expected) -> list[Mistake]:
        """One joint, or all, have a gear or a unit that the map does not know of; its size is what fits best."""
        found = []
        for who, joints in self._sets():

            def geared(r: float, who: str = who, joints: list[int] = joints) -> Mistake:
                text = f"the gear of {who} is wrong: what is read is {r:.3g} times what it moves"
                return self.made("gear", text, joints, scale=dict.fromkeys(joints, r))

            best = _least(geared, seen, expected, _RATIOS, lambda r, step: r * np.exp(step))
            if not 0.85 < best < 1.18:
                found.append(geared(best))
        return found

    def units(self) -> list[Mistake]:
        """One joint, or all that turn or slide, are read in another unit, and may count the other way round, too."""
        found = []
        for (who, joints), (unit, (moves, factor, one, other)) in product(self._sets(), _UNITS.items()):
            alike = [j for j in joints if self._units[j] == unit]
            whose = who if len(alike) == len(joints) else f"{who} that {moves}"
            for size, sign in product((factor, 1.0 / factor) if alike else (), (1, -1)):
                read, taken = (one, other) if size > 1.0 else (other, one)
                text = f"{whose} comes in {read} and is taken for {taken}" + ", with the other sign" * (sign < 0)
                found.append(self.made("unit", text, alike, scale=dict.fromkeys(alike, sign * size)))
        return found

    def torques(self, seen: Response, expected: Expected) -> list[Mistake]:
        """All torques are read with another sign or unit."""

        def read(r: float) -> Mistake:
            how = "with the other sign" if -1.25 < r < -0.8 else f"{r:.2g} times as large as they are"
            made = self.made("torque", f"the torques of all joints are read {how}", range(self.n))
            return replace(made, force=np.full(self.n, 1.0 / r))

        starts = [sign * r for sign in (1.0, -1.0) for r in _RATIOS]
        best = _least(read, seen, expected, starts, lambda r, step: r * np.exp(step))
        return [] if 0.8 < best < 1.25 else [read(best)]

    def hidden(self, seen: Response, expected: Expected) -> list[str]:
        """What torques do not show of a robot that is as ``seen``: gears, units and offsets of light joints."""
        found = []
        units = [_UNITS[unit][1] for unit in self._units]
        for what, name, wrong in (
            ("gear", "scale", [(0.5, 2.0)] * self.n),
            ("unit", "scale", [(factor, 1.0 / factor) for factor in units]),
            ("offset", "offset", [(-0.3, 0.3)] * self.n),
        ):
            joints = [
                self.names[i]
                for i, sizes in enumerate(wrong)
                if any(
                    expected.cost(self.made(what, "", [i], **{name: {i: size}}).applied(seen)) < 2.0 * CONVINCING
                    for size in sizes
                )
            ]
            if joints:
                found.append(f"not shown by torques: the {what} of {', '.join(joints)}")
        return found

    def shifted(self, seen: Response, expected: Expected) -> list[Mistake]:
        """One joint that is off by a constant; its size is what fits best."""
        found = []
        for i in range(self.n):

            def off(by: float, i: int = i) -> Mistake:
                return self.made("offset", f"{self.names[i]} is off by {by:.2f} {self._units[i]}", [i], offset={i: by})

            best = _least(off, seen, expected, np.linspace(-np.pi, np.pi, 64), lambda by, step: by + step)
            if abs(best) > 0.08:
                found.append(off(best))
        return found


def _least(
    mistake: Callable[[float], Mistake], seen: Response, expected: Expected, starts: Iterable[float],
    stepped: Callable[[float, float], Any],
) -> float:  # fmt: skip
    """The size with which a mistake costs least, by smaller and smaller steps from the best of ``starts``."""

    def cost(size: float) -> float:
        return expected.cost(mistake(size).applied(seen))

    best = float(min(starts, key=cost))
    for step in (0.2, 0.05, 0.02, 0.007):
        for _ in range(3):
            best = float(min((stepped(best, step * k) for k in (-2, -1, 0, 1, 2)), key=cost))
    return best


def _beyond(size: Any, allowed: Any) -> Any:
    """The share of sizes that is beyond what is allowed."""
    return np.maximum(1.0 - allowed / (size + 1e-12), 0.0)


def _pairings(n: int) -> list[tuple[int, ...]]:
    """All ways to exchange some of n things in pairs, but for the one that leaves all; of many, one pair at a time."""
    found = [tuple(range(n))]
    for i in range(n):
        for j in range(i + 1, n):
            for order in list(found) if n <= _FEW else found[:1]:
                if order[i] == i and order[j] == j:
                    swapped = list(order)
                    swapped[i], swapped[j] = j, i
                    found.append(tuple(swapped))
    return found[1:]


def _orders(n: int) -> list[tuple[int, ...]]:
    """Other orders of n things in a row: all of three; of more, backwards, and shifted by one either way."""
    row = tuple(range(n))
    if n <= 3:
        return [*permutations(row)][1:]
    return [row[::-1], (*row[1:], row[0]), (row[-1], *row[:-1])]
