"""The working-set loop: guess, solve the equality problem, verify, exchange; then the finite method.

From one tick of a controller to the next the working set rarely changes, so the last one is nearly always right and a
solve is one factorisation. While the number of wrong items falls, all are exchanged at once (block principal pivoting);
after a few guesses the finite method starts from the best of them. The certificate is the only judge of an answer.

Júdice, Pires: A block principal pivoting algorithm for large-scale strictly monotone linear complementarity problems,
Computers & Operations Research 21(5), 1994.
"""

from __future__ import annotations

from math import inf

from wbc.compiled import copy, part, small_kernel
from wbc.qp.rows.compiled.equality import evaluate, hold_guess, move, place, reduce_base, reduced, step
from wbc.qp.rows.compiled.finite import finite
from wbc.qp.rows.compiled.verify import certified, exchange, split, verify, weigh
from wbc.qp.rows.compiled.work import FAILED, INACCURATE, SOLVED, views
from wbc.tolerances import DISTANCE, MET, SHARP
from wbc.types import Vec

#: Working sets that are guessed before the finite method starts.
_GUESSES = 5
#: Exchanges in a row that may fail to lower the number of wrong items.
_CHANCES = 1
#: Steps of refinement at most.
_REFINED = 4


@small_kernel
def allow(lower: Vec, upper: Vec, side: Vec) -> int:
    """Free what bounds do not hold, and hold what they fix; how many of them are intervals."""
    sound = 0
    for i in range(len(side)):
        low, high, held = lower[i], upper[i], side[i]
        sound += int(low <= high)
        may = int(abs(held) <= 1.0) & int(held <= 0.0 or high < inf) & int(held >= 0.0 or low > -inf)
        side[i] = 1.0 if low == high else held if may else 0.0
    return sound


@part
def prepare(at: int) -> bool:
    """Soft rows in y, and the guess as the bounds allow it. False: a number that no problem can have."""
    s, nothing = views(at), 0.0
    nu, ny, nr, ns = s.sizes[0], s.sizes[1], s.sizes[2], s.sizes[3]
    s.sizes[6], s.sizes[7], s.sizes[8] = ns + nu, 0, 0
    s.value[nu + ny] = 1.0
    if not (reduce_base(at) and weigh(s)):
        return False
    for k in range(ns):
        reduced(s, s.G[nu + nr + k], s.E[k])
        s.item[k] = -1
    for j in range(nu):
        copy(s.X[j], s.E[ns + j])
        s.item[ns + j] = -1
    for c in range(ny):
        nothing += 0.0 * s.centre[c]
    first_range, first_equal = 2 * nu + ny + 1, 2 * nu + ny + 1 + nr + ns
    sound = allow(s.lower[nu:], s.upper[nu:], s.side[:ny])
    sound += allow(s.lower[first_range:], s.upper[first_range:], s.side[ny : ny + nr])
    sound += allow(s.lower[first_equal:], s.upper[first_equal:], s.side[ny + nr :])
    return bool(nothing == 0.0 and sound == len(s.side))  # NaN is not zero


@part
def refined(at: int, is_first: bool) -> int:
    """A step, and more with the same working set while they help; how many items are wrong then.

    Where nothing but the distance from the optimum is in doubt, the best split decides, and where to go on.
    """
    s = views(at)
    wrong, distance, held = 0, inf, inf
    for k in range(1 + _REFINED):
        step(at, is_first and k == 0)
        evaluate(at)
        wrong = verify(at)
        helps = s.proof[5] <= 0.5 * distance or s.numbers[2] < 0.5 * held
        distance, held = s.proof[5], s.numbers[2]
        if wrong or not helps or (distance <= SHARP and held <= 1.0):
            break
    for _ in range(_REFINED):
        if wrong or s.numbers[2] > 1.0 or not s.proof[5] > DISTANCE * MET:
            break
        split(at)
        if not certified(s):
            move(at)
            evaluate(at)
            wrong = verify(at)
    return wrong


@part
def search(at: int) -> bool:
    """Guess, verify, exchange: whether that ends with a certified answer. The best guess is kept."""
    s = views(at)
    fewest, chances = len(s.side) + 1, _CHANCES
    copy(s.side, s.best)
    while s.sizes[7] < _GUESSES:
        s.sizes[7] += 1
        if not hold_guess(at):
            break
        place(at)
        wrong = refined(at, True)
        if wrong == 0:
            if s.numbers[2] <= 1.0 and certified(s):
                return True
            break
        if wrong < fewest:
            fewest, chances = wrong, _CHANCES
            copy(s.side, s.best)
        elif chances == 0:
            break
        else:
            chances -= 1
        exchange(at)
    return False


@part
def decide(at: int) -> int:
    """The answer by the finite method, which also finds the proof that there is none.

    What it adds up drifts, and what drifts may hide what is broken: it goes on from where refining leads.
    """
    s, found = views(at), SOLVED
    for _ in range(_REFINED):
        found = finite(at)
        if found != SOLVED:
            break
        refined(at, False)
        if certified(s):
            return SOLVED
        found = INACCURATE
        copy(s.side, s.best)
    return found


@part
def answer(at: int) -> int:
    """The answer in ``value``, its working set in ``side``, its multipliers in ``push`` and ``z``, and ``proof``.

    Where guesses lead nowhere the finite method decides, from the best of them.
    """
    if not prepare(at):
        return FAILED
    return SOLVED if search(at) else decide(at)


@part
def answer_near(at: int) -> int:
    """The same for a guess that is nearly right: the finite method goes on from it."""
    if not prepare(at):
        return FAILED
    s = views(at)
    copy(s.side, s.best)
    return decide(at)
