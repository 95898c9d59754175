"""Diagnosis: what is wrong, read from a momentum observer after its alarm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from wbc.models.model import RobotState
from wbc.types import Vec

from .load import Load, LoadFit
from .momentum_observer import MomentumObserver

#: What can be wrong: of an actuator, or with the robot's surroundings.
ACTUATOR = ("total", "partial", "bias", "saturation")
KINDS = (*ACTUATOR, "external", "payload")
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
#: A joint without torque misses none. One that still misses this share of what it did before is pushed.
STILL_MISSING = 0.5


@final
@dataclass(frozen=True)
class Diagnosis:
    """One decision. ``joint`` is the one that misses most of its threshold, of an external force the last one that
    feels it.

    kind        "total", "partial", "bias", "saturation" of an actuator; "external": several joints miss torque, or one
                that has none; "payload": what they miss is the weight and inertia of one body in a hand
    share       of a total or partial loss: what is lost of the command, 0 to 1
    offset      of a bias: what is missing whatever the command [N m, N]
    ceiling     of a saturation: the most that still arrives [N m, N]
    missing     (nj,) mean missing torques since the alarm [N m, N]
    alarmed, t  times of the alarm and of the decision [s]
    repeated    how often this joint had been diagnosed before
    load        of a payload: its mass and centre
    instead_of  joints whose motors were diagnosed before, and are sound after all
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
    load: Load | None = None
    instead_of: tuple[int, ...] = ()

    def __str__(self) -> str:
        what = {
            "total": "total loss",
            "partial": f"{100 * self.share:.0f} % lost",
            "bias": f"bias of {self.offset:.3g}",
            "saturation": f"saturates at {self.ceiling:.3g}",
            "external": "external force, felt up to here",
            "payload": f"payload of {self.load.mass:.3g} kg in {self.load.frame}" if self.load else "payload",
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
    ``recheck`` [s] after an alarm's decision it is looked at once more, with all that was seen since: a joint that was
    called dead, is sent nothing and still misses torque is pushed, and its motor sound.

    From an alarm on it is also tried whether a load in one of ``hands`` explains everything that sound joints miss
    (:class:`~tasks.components.load.LoadFit`). Where one does, once for each hand, what was said of motors meanwhile is
    taken back.

    ``noise`` (nj,): standard deviation of one tick's missing torques [N m, N]. ``lockout`` [s]: after a decision other
    joints are not judged for so long, since everything moves; the same joint is, after ``settle`` [s].
    """

    def __init__(
        self, names: tuple[str, ...], *, noise: Vec, lockout: float, settle: float, recheck: float,
        dominance: float, start: float, hands: Sequence[str] = (),
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
        self._since_total: dict[int, _Sums] = {}
        self._joint, self._alarmed = -1, 0.0
        self._hands, self._fits = list(hands), list[LoadFit]()
        self._weighed_from, self._suspects = 0.0, set[int]()

    def ignore(self, joint: int) -> None:
        """Raise no alarm of this joint again; the last decision on it is still looked at once more."""
        self._from[joint] = np.inf

    def settle(self, joint: int) -> None:
        """The last decision on this joint is final."""
        self._check.pop(joint, None)
        self._since_total.pop(joint, None)

    def leave(self, diagnosis: Diagnosis) -> None:
        """Nothing was done about it: its alarm, and others that ring now, say nothing new until they have fallen."""
        self._left[:] = True
        if diagnosis.kind in ACTUATOR:
            self._repeated[diagnosis.joint] = 0
            self.settle(diagnosis.joint)
            self._from[diagnosis.joint] = diagnosis.t + self._settle

    def tick(self, state: RobotState, observer: MomentumObserver) -> Diagnosis | None:
        """One tick later. The decision, at the tick when it falls."""
        t, command, known = state.t, observer.command, observer.known
        total = observer.missing + known
        for sums in (*self._since_first.values(), *self._since_total.values()):
            sums.add(command, total)
        for fit in self._fits:
            fit.add(state, observer.dt, total, observer.rows)
        if self._recent is not None:
            self._recent.add(command, total)
            return self._decided(t, observer, known)
        if self._alarm_begins(t, observer):
            return None
        for i in [i for i, when in self._check.items() if t >= when]:
            return self._checked(t, i, observer)
        return self._weighed(t, observer)

    def _alarm_begins(self, t: float, observer: MomentumObserver) -> bool:
        alarm = observer.alarm
        self._left &= alarm
        ready = alarm & ~self._left & (t >= self._from)
        if not ready.any():
            return False
        size = np.where(ready, np.abs(observer.residual) / observer.threshold, -1.0)
        self._joint, self._alarmed = int(size.argmax()), t
        self._recent = _Sums(len(self._names))
        if not self._repeated[self._joint]:
            self._since_first[self._joint] = _Sums(len(self._names))
        if self._hands and not self._fits:
            sound = np.array([i not in self._standing for i in range(len(self._names))])
            self._fits = [LoadFit(hand, observer.threshold, sound) for hand in self._hands]
            self._weighed_from, self._suspects = t, set()
        return True

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
            if self._weighed_from == self._alarmed:
                self._fits.clear()
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

    def _checked(self, t: float, i: int, observer: MomentumObserver) -> Diagnosis | None:
        """The last decision on a joint again, with all that was seen since its first alarm; None where it stands."""
        standing, since = self._standing[i], self._since_total.get(i)
        self.settle(i)
        if standing.kind == "total":
            if since is None or not since.ticks or since.uu[i] > 0.0:  # nothing was done: it is asked for torque
                return None
            missing = since.m / since.ticks
            if abs(missing[i]) < max(STILL_MISSING * abs(standing.missing[i]), observer.threshold[i]):
                return None
            pushed = replace(standing, kind="external", t=t, missing=missing, share=0.0, instead_of=(i,))
            self._acquit(t, (i,))
            return pushed
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
            self._suspects.add(i)
            self._from[i] = decided.t + self._settle
            if decided.kind == "total":
                self.ignore(i)
                self._since_total[i] = _Sums(len(self._names))
                self._check[i] = decided.t + self._recheck
        return decided

    def _acquit(self, t: float, joints: Sequence[int]) -> None:
        """These motors are sound after all."""
        for i in joints:
            self.settle(i)
            self._standing.pop(i, None)
            self._repeated[i] = 0
            self._from[i] = t + self._lockout

    def _weighed(self, t: float, observer: MomentumObserver) -> Diagnosis | None:
        """The load that explains all that is missing since the alarm, once one does."""
        self._fits = [fit for fit in self._fits if not fit.over]
        for fit in self._fits:
            load = fit.load()
            if load is not None:
                self._fits, suspects = [], tuple(sorted(self._suspects))
                self._hands.remove(load.frame)
                self._acquit(t, suspects)
                self._from = np.maximum(self._from, t + self._settle)
                i = int((np.abs(observer.residual) / observer.threshold).argmax())
                return Diagnosis(
                    "payload", i, self._names[i], self._weighed_from, t, observer.missing, load=load,
                    instead_of=suspects,
                )  # fmt: skip
        return None

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
