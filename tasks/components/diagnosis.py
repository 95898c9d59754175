"""Diagnosis: what is wrong, read from a momentum observer after its alarm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from tasks.components.momentum_observer import MomentumObserver
from wbc.types import Vec

#: What can be wrong: of an actuator, or with the robot's surroundings.
ACTUATOR = ("total", "partial", "bias", "saturation")
KINDS = (*ACTUATOR, "external")
#: A share lost above this is a total loss: what is left is no motor to build on.
TOTAL = 0.8
#: Shares between these are a loss of effectiveness; others are no actuator's doing, or a bias.
POSSIBLE = (0.15, 1.3)
#: The share lost is known once its standard error is below this …
KNOWN = 0.1
#: … or after so many ticks, whatever it is. A bias has to last as long as ``LASTING`` ticks.
LONGEST, LASTING = 20, 50
#: A share known better by less than this changes nothing.
AS_GOOD = 0.02


@final
@dataclass(frozen=True)
class Diagnosis:
    """One decision. ``joint`` is the one that misses most of its threshold, of an external force the last one that
    feels it.

    kind        "total", "partial", "bias", "saturation" of an actuator, or "external": several joints miss torque
    share       of a total or partial loss: what is lost of the command, 0 to 1
    offset      of a bias: what is missing whatever the command [N m, N]
    ceiling     of a saturation: the most that still arrives [N m, N]
    missing     (nj,) mean missing torques since the alarm [N m, N]
    alarmed, t  times of the alarm and of the decision [s]
    repeated    how often this joint had been diagnosed before
    """

    kind: str
    joint: int
    joint_name: str
    alarmed: float
    t: float
    missing: Vec
    share: float = 0.0
    offset: float = 0.0
    ceiling: float = np.inf
    repeated: int = 0

    def __str__(self) -> str:
        what = {
            "total": "total loss",
            "partial": f"{100 * self.share:.0f} % lost",
            "bias": f"bias of {self.offset:.3g}",
            "saturation": f"saturates at {self.ceiling:.3g}",
            "external": "external force, felt up to here",
        }[self.kind]
        return f"{self.t:.3f} s: {self.joint_name}: {what} (alarm at {self.alarmed:.3f} s)"


class _Sums:
    """Sums over ticks of command u and missing torque m of every joint, (nj,) each."""

    def __init__(self, nj: int) -> None:
        self.ticks = 0
        self.u, self.m, self.uu, self.um, self.mm = np.zeros((5, nj))

    def add(self, u: Vec, m: Vec) -> None:
        self.ticks += 1
        self.u += u
        self.m += m
        self.uu += u * u
        self.um += u * m
        self.mm += m * m

    def misfits(self, i: int) -> dict[str, float]:
        """Squares that are left of the motor's law with one constant each: m = l u, m = b, u − m = c."""
        n, u, m, uu, um, mm = self.ticks, self.u[i], self.m[i], self.uu[i], self.um[i], self.mm[i]
        return {
            "partial": mm - um * um / uu if uu > 0.0 else np.inf,
            "bias": mm - m * m / n,
            "saturation": uu - 2.0 * um + mm - (u - m) ** 2 / n,
        }


@final
class Diagnoser:
    """Watches an observer from tick to tick and says, some ticks after its alarm, what is wrong.

    At an alarm the sums of the command and of the missing torque of every joint start together, so that their ratio is
    the share lost without lag, whatever the residual's lag is. White noise of the measured velocity telescopes in the
    sum of missing torques: its standard error falls with the number of ticks, and the decision falls when it is small
    enough (``KNOWN``), at the first tick where there is no noise. The alarm with the largest residual in units of its
    threshold is the one that counts.

    A single joint with a share in ``POSSIBLE`` has lost it; "single" means that it is ``dominance`` times as far beyond
    its threshold as any other. At its first decision a joint has lost a share; when it is
    decided on again, the law is taken that fits all commands since the first alarm best: a share, a bias or a ceiling.
    The third alarm is a total loss. A share out of range has to last for ``LASTING`` ticks, to be called a bias.
    ``recheck`` [s] after an alarm's decision it is looked at once more, with all that was seen since.

    ``noise`` (nj,): standard deviation of one tick's missing torques [N m, N]. ``lockout`` [s]: after a decision other
    joints are not judged for so long, since everything moves; the same joint is, after ``settle`` [s].
    """

    def __init__(
        self, names: tuple[str, ...], *, noise: Vec, lockout: float, settle: float, recheck: float,
        dominance: float, start: float,
    ) -> None:  # fmt: skip
        self._names, self.noise = names, noise
        self._lockout, self._settle, self._recheck = lockout, settle, recheck
        self._dominance = dominance
        self._from = np.full(len(names), start)  # when each joint may be judged again
        self._repeated = np.zeros(len(names), dtype=int)
        self._left = np.zeros(len(names), dtype=np.bool_)
        self._since_first: dict[int, _Sums] = {}
        self._standing: dict[int, Diagnosis] = {}
        self._check: dict[int, float] = {}  # when the standing decision is looked at again
        self._recent: _Sums | None = None
        self._joint, self._alarmed = -1, 0.0

    def ignore(self, joint: int) -> None:
        """Never judge this joint again."""
        self._from[joint] = np.inf
        self._check.pop(joint, None)

    def leave(self, diagnosis: Diagnosis) -> None:
        """Nothing was done about it: its alarm, and others that ring now, say nothing new until they have fallen."""
        self._left[:] = True
        if diagnosis.kind in ACTUATOR:
            self._repeated[diagnosis.joint] = 0
            self._check.pop(diagnosis.joint, None)
            self._from[diagnosis.joint] = diagnosis.t + self._settle

    def tick(self, t: float, observer: MomentumObserver) -> Diagnosis | None:
        """One tick later. The decision, at the tick when it falls."""
        command, known = observer.command, observer.known
        total = observer.missing + known
        for sums in self._since_first.values():
            sums.add(command, total)
        if self._recent is not None:
            self._recent.add(command, total)
            return self._decided(t, observer, known)
        self._look_for_an_alarm(t, observer)
        due = [i for i, when in self._check.items() if t >= when] if self._recent is None else []
        return self._checked(t, due[0]) if due else None

    def _look_for_an_alarm(self, t: float, observer: MomentumObserver) -> None:
        alarm = observer.alarm
        self._left &= alarm
        ready = alarm & ~self._left & (t >= self._from)
        if not ready.any():
            return
        size = np.where(ready, np.abs(observer.residual) / observer.threshold, -1.0)
        self._joint, self._alarmed = int(size.argmax()), t
        self._recent = _Sums(len(self._names))
        if not self._repeated[self._joint]:
            self._since_first[self._joint] = _Sums(len(self._names))

    def _decided(self, t: float, observer: MomentumObserver, known: Vec) -> Diagnosis | None:
        """What an alarm means, once its sums say it."""
        sums, i = self._recent, self._joint
        assert sums is not None
        n, mean = sums.ticks, sums.m / sums.ticks
        unknown = np.abs(mean - known)
        if self.noise[i] > KNOWN * abs(sums.u[i]) and n < LONGEST:
            return None
        if unknown[i] < 0.5 * observer.threshold[i]:
            self._recent = None  # it was noise
            return None
        # To others a joint's own fault does nothing, but what it starts to move shows what is wrong with the masses.
        sizes = unknown / observer.threshold
        others = unknown > observer.threshold + 3.0 * self.noise / n
        others[i] = False
        share = sums.m[i] / sums.u[i] if sums.u[i] else np.inf
        possible = POSSIBLE[0] <= share <= POSSIBLE[1]
        if others.any() and not (possible and (self._dominance * sizes[others] < sizes[i]).all()):
            return self._decision(t, "external", max(i, int(np.flatnonzero(others)[-1])), sums)
        if possible:
            law = "partial" if not self._repeated[i] else self._law(i)
            return self._decision(t, "total" if law == "partial" and self._repeated[i] >= 2 else law, i, sums)
        return None if n < LASTING else self._decision(t, "bias", i, sums)

    def _law(self, i: int) -> str:
        """Which law of a failing motor fits its commands since the first alarm best; a share, if nearly as well."""
        misfits = self._since_first[i].misfits(i)
        best = min(misfits, key=lambda law: misfits[law])
        clearly = misfits["partial"] - misfits[best] > 10.0 * self.noise[i] ** 2 + 0.1 * misfits["partial"]
        return best if clearly else "partial"

    def _checked(self, t: float, i: int) -> Diagnosis | None:
        """The last decision on a joint again, with all that was seen since its first alarm; None where it stands."""
        del self._check[i]
        standing = self._standing[i]
        better = self._read(t, self._law(i), i, self._since_first[i])
        if better.kind == standing.kind and abs(better.share - standing.share) < AS_GOOD:
            return None
        return self._settled(better)

    def _decision(self, t: float, kind: str, i: int, sums: _Sums) -> Diagnosis:
        decided = self._read(t, kind, i, sums)
        self._recent = None
        self._from = np.maximum(self._from, t + self._lockout)
        if decided.kind in ACTUATOR:
            self._repeated[i] += 1
            self._check[i] = t + self._recheck
        return self._settled(decided)

    def _settled(self, decided: Diagnosis) -> Diagnosis:
        i = decided.joint
        if decided.kind in ACTUATOR:
            self._standing[i] = decided
            self._from[i] = decided.t + self._settle
            if decided.kind == "total":
                self.ignore(i)
        return decided

    def _read(self, t: float, kind: str, i: int, sums: _Sums) -> Diagnosis:
        """The constant of a law, from the sums."""
        share, offset, ceiling = 0.0, 0.0, np.inf
        if kind in ("partial", "total"):
            share = float(np.clip(sums.m[i] / sums.u[i], 0.0, 1.0))
            kind = "total" if kind == "total" or share > TOTAL else "partial"
        elif kind == "bias":
            offset = float(sums.m[i] / sums.ticks)
        elif kind == "saturation":
            ceiling = float(abs(sums.u[i] - sums.m[i]) / sums.ticks)
        missing = sums.m / sums.ticks
        return Diagnosis(
            kind, i, self._names[i], self._alarmed, t, missing, share, offset, ceiling, int(self._repeated[i])
        )
