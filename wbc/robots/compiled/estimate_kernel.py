"""What a sample of the sensors does to an estimate of a base, as :mod:`wbc.robots.estimator` describes it."""

from __future__ import annotations

from math import inf, isfinite, sqrt
from typing import Annotated, NamedTuple

from wbc.compiled import Layout, copy, entry, kernel, small_kernel
from wbc.robots.compiled.filter_kernel import (
    Filter,
    cholesky,
    copy_estimate,
    correct,
    distance,
    doubt,
    exponentials,
    filter_at,
    innovation,
    level,
    place,
    predict,
)  # fmt: skip
from wbc.types import Index, Mat, Vec

#: A sample that comes later than this after the one before is a gap [s], 20 ms and what the time of day is rounded by;
#: what the IMU missed then, at most, is taken to be a rate [rad/s] and an acceleration [m/s²] of this size.
GAP, MISSED_RATE, MISSED_ACCELERATION = 0.02 + 1e-6, 1.0, 5.0
#: Places in ``sizes``: address of the filter, feet, joints, parts of the sample that are there as bits.
FILTER, FEET, JOINTS, PARTS = range(4)
#: The parts of a sample.
JOINT_Q, JOINT_V, GYRO, FORCE, TAU, PRESSURES = range(6)
#: Places in ``numbers``: squares of the errors of encoders and of what is rigid; errors of the rates of base and joints
#: in a sample, and their agility; forces at which a foot begins and ends to touch, how long the first must last;
#: variance of the heights of footholds and its gate; the least gate of a foot; how late samples are.
JOINT2, FLEX2, GYRO_NOISE, RATE_NOISE, GYRO_AGILITY, RATE_AGILITY = range(6)
MAKE, BREAK, SETTLE, FLOOR2, FLOOR_GATE, LEAST_GATE, LATE = range(6, 13)
#: Places in ``clock``: time of the sample and of the one before (NaN: none), between them; height of the floor (NaN:
#: not known yet), and with this sample.
NOW, BEFORE, STEP, HEIGHT, NOW_HEIGHT = range(5)
#: Of a foot that carries through a straight leg no joint feels the force.
_STRAIGHT = 1e-6
#: What a foot does in a sample.
AWAY, LANDS, STANDS = range(3)


class Estimate(NamedTuple):
    """The memory of an estimator with c feet, k points and j joints."""

    sizes: Annotated[Index, "5"]
    numbers: Annotated[Vec, "13"]
    clock: Annotated[Vec, "5"]
    most: Annotated[Vec, "6"]  # that any sensor says, of each part of a sample
    up: Annotated[Vec, "3"]
    lever: Annotated[Vec, "3"]  # the IMU in the base
    mount: Annotated[Mat, "3, 3"]  # from its axes to the base's
    first: Annotated[Index, "c + 1"]  # point of each foot
    is_flat: Annotated[Index, "c"]
    radius: Annotated[Vec, "c"]
    gates: Annotated[Vec, "c"]
    offsets: Annotated[Mat, "k, 3"]  # of the points in their feet
    joint_q: Annotated[Vec, "j"]
    joint_v: Annotated[Vec, "j"]
    gyro: Annotated[Vec, "3"]
    force: Annotated[Vec, "3"]
    tau: Annotated[Vec, "j"]
    pressures: Annotated[Vec, "c"]
    h: Annotated[Vec, "j"]  # of the joints; what follows is of the frames of the feet, the base at the origin
    position: Annotated[Mat, "c, 3"]
    rotation: Annotated[Mat, "3 * c, 3"]
    jacobian: Annotated[Mat, "6 * c, j"]
    former: Annotated[Mat, "3 * c, 3"]  # rotation in the sample before, with the base as it was estimated then
    normal: Annotated[Vec, "c"]
    since: Annotated[Vec, "c"]  # when it began to press
    now_since: Annotated[Vec, "c"]
    touches: Annotated[Index, "c"]
    does: Annotated[Index, "c"]  # in this sample: AWAY, LANDS, STANDS
    slips: Annotated[Index, "c"]
    arms: Annotated[Mat, "k, 3"]  # from the IMU to each point, its axes
    lines: Annotated[Mat, "3 * k, j"]  # their Jacobian, world axes
    gram: Annotated[Mat, "6, 6"]
    factor: Annotated[Mat, "6, 6"]
    six: Annotated[Vec, "6"]
    nine: Annotated[Vec, "9"]
    base: Annotated[Mat, "3, 3"]
    out_q: Annotated[Vec, "7 + j"]  # the last estimate, moved on by how late it is
    out_v: Annotated[Vec, "6 + j"]
    q: Annotated[Vec, "7 + j"]  # the last estimate
    v: Annotated[Vec, "6 + j"]
    a: Annotated[Vec, "6 + j"]  # of the rates
    now_q: Annotated[Vec, "7 + j"]  # that of this sample
    now_v: Annotated[Vec, "6 + j"]
    now_a: Annotated[Vec, "6 + j"]


LAYOUT = Layout(Estimate, c="sizes[1]", j="sizes[2]", k="sizes[4]")
_at = LAYOUT.views


@kernel
def _bad(e: Estimate) -> int:
    """The first part of the sample that no sensor says, from 1; 0 where it is sound."""
    for part in range(6):
        if not e.sizes[PARTS] >> part & 1:
            continue
        values = (e.joint_q, e.joint_v, e.gyro, e.force, e.tau, e.pressures)[part]
        for i in range(len(values)):
            if not abs(values[i]) <= e.most[part]:
                return part + 1
    return 0


@kernel
def _attitude(e: Estimate, f: Filter) -> None:
    """The rotation of the base, its quaternion near the last one, and its rate, raw."""
    R = e.base
    for i in range(3):
        rate = 0.0
        for j in range(3):
            R[i, j] = f.R[i, 0] * e.mount[j, 0] + f.R[i, 1] * e.mount[j, 1] + f.R[i, 2] * e.mount[j, 2]
            rate += e.mount[i, j] * (e.gyro[j] - f.bias[j])
        e.now_v[3 + i] = rate
    # Four times the squares of the entries; from the largest one the others follow.
    most, at = 1.0 + R[0, 0] + R[1, 1] + R[2, 2], 3
    for i in range(3):
        square = 1.0 + 2.0 * R[i, i] - R[0, 0] - R[1, 1] - R[2, 2]
        if square > most:
            most, at = square, i
    entries = e.six
    if at == 3:
        entries[0], entries[1], entries[2] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
        entries[3] = most
    else:
        j, k = (at + 1) % 3, (at + 2) % 3
        entries[at], entries[3] = most, R[k, j] - R[j, k]
        entries[j], entries[k] = R[at, j] + R[j, at], R[at, k] + R[k, at]
    square, near = 0.0, 0.0
    for i in range(4):
        square += entries[i] * entries[i]
        near += entries[i] * e.q[3 + i]
    for i in range(4):
        e.now_q[3 + i] = entries[i] / (sqrt(square) if near >= 0.0 else -sqrt(square))


@small_kernel
def dotted(a: Vec, b: Vec) -> float:
    """a · b of the first three."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def _finite(values: Vec) -> bool:
    for value in values:
        if not isfinite(value):
            return False
    return True


@kernel
def _press(e: Estimate) -> None:
    """The normal force on each foot [N]; inf where nobody knows."""
    for i in range(e.sizes[FEET]):
        if e.sizes[PARTS] >> PRESSURES & 1:
            e.normal[i] = e.pressures[i]
        elif not e.sizes[PARTS] >> TAU & 1:
            e.normal[i] = inf
        else:
            rows = 6 if e.is_flat[i] else 3
            trace = 0.0
            for a in range(rows):
                e.six[a] = 0.0
                for j in range(e.sizes[JOINTS]):
                    e.six[a] += e.jacobian[6 * i + a, j] * (e.h[j] - e.tau[j])
                for b in range(rows):
                    e.gram[a, b] = 0.0
                    for j in range(e.sizes[JOINTS]):
                        e.gram[a, b] += e.jacobian[6 * i + a, j] * e.jacobian[6 * i + b, j]
                trace += e.gram[a, a]
            for a in range(rows):
                e.gram[a, a] += _STRAIGHT * trace
            e.normal[i] = 0.0
            if cholesky(e.gram, 0, rows, e.factor):
                distance(e.factor, rows, e.six, 0)
                for a in range(rows - 1, -1, -1):
                    for b in range(a + 1, rows):
                        e.six[a] -= e.factor[b, a] * e.six[b]
                    e.six[a] /= e.factor[a, a]
                e.normal[i] = dotted(e.up, e.six)


@kernel
def _feel(e: Estimate) -> None:
    """What each foot does."""
    now, has_begun = e.clock[NOW], isfinite(e.clock[BEFORE])
    for i in range(e.sizes[FEET]):
        e.now_since[i] = min(e.since[i], now if has_begun else -inf) if e.normal[i] > e.numbers[MAKE] else inf
        if e.touches[i]:
            touches = e.normal[i] >= e.numbers[BREAK]
        else:
            touches = now - e.now_since[i] >= e.numbers[SETTLE] - 1e-9
        stood = e.touches[i] and e.clock[STEP] <= GAP
        e.does[i] = AWAY if not touches else STANDS if stood else LANDS
        e.slips[i] = 0


@kernel
def _see(e: Estimate, f: Filter) -> None:
    """Where the encoders see each point from the IMU, and its Jacobian."""
    for foot in range(e.sizes[FEET]):
        J = e.jacobian
        for k in range(e.first[foot], e.first[foot + 1]):
            x, arm = e.nine[:3], e.nine[3:6]
            for i in range(3):
                x[i] = dotted(e.rotation[3 * foot + i], e.offsets[k])
                arm[i] = e.position[foot, i] + x[i] - dotted(e.base[i], e.lever)
            for i in range(3):
                e.arms[k, i] = f.R[0, i] * arm[0] + f.R[1, i] * arm[1] + f.R[2, i] * arm[2]
                after, before = (i + 1) % 3, (i + 2) % 3
                for j in range(e.sizes[JOINTS]):
                    e.lines[3 * k + i, j] = (
                        J[6 * foot + i, j]
                        + J[6 * foot + 3 + after, j] * x[before]
                        - J[6 * foot + 3 + before, j] * x[after]
                    )


@kernel
def _roll(e: Estimate, f: Filter) -> None:
    """Let the points of balls roll by what their links have turned."""
    turn = e.gram
    for foot in range(e.sizes[FEET]):
        if e.radius[foot] == 0.0:
            continue
        for i in range(3):
            for j in range(3):
                turn[i, j] = dotted(e.rotation[3 * foot + i], e.former[3 * foot + j])
        for i in range(3):
            after, before = (i + 1) % 3, (i + 2) % 3
            e.six[i] = 0.5 * (turn[before, after] - turn[after, before])
        for k in range(e.first[foot], e.first[foot + 1]):
            for i in range(3):
                after, before = (i + 1) % 3, (i + 2) % 3
                f.d[k, i] += e.radius[foot] * (e.six[after] * e.up[before] - e.six[before] * e.up[after])


@kernel
def _remember(e: Estimate, foreseen: Mat) -> None:
    """How the feet are turned with the base as it is estimated now, not as ``foreseen`` (3, 3): a correction is no
    roll."""
    for foot in range(e.sizes[FEET]):
        for j in range(3):
            column = e.nine[:3]
            for i in range(3):
                column[i] = 0.0
                for k in range(3):
                    column[i] += foreseen[k, i] * e.rotation[3 * foot + k, j]
            for i in range(3):
                e.former[3 * foot + i, j] = dotted(e.base[i], column)


@kernel
def _choose(e: Estimate, f: Filter, what: int) -> int:
    """Choose the points of the feet that do this, say where they are seen, and how well; how many they are."""
    m = 0
    for foot in range(e.sizes[FEET]):
        if e.does[foot] == what:
            for k in range(e.first[foot], e.first[foot + 1]):
                f.chosen[m] = k
                for i in range(3):
                    f.y[m, i] = dotted(f.R[i], e.arms[k])
                m += 1
    f.sizes[1] = m
    for a in range(3 * m):
        for b in range(a + 1):
            one, two = e.lines[3 * f.chosen[a // 3] + a % 3], e.lines[3 * f.chosen[b // 3] + b % 3]
            total = 0.0
            for j in range(e.sizes[JOINTS]):
                total += one[j] * two[j]
            f.N[a, b] = f.N[b, a] = e.numbers[JOINT2] * total + (e.numbers[FLEX2] if a == b else 0.0)
    return m


@kernel
def _stay(e: Estimate, f: Filter) -> bool:
    """Correct by the feet that stood and have not moved; False where a covariance is none."""
    if not _choose(e, f, STANDS):
        return True
    innovation(f)
    done = correct(f, e.numbers[LEAST_GATE])  # no foot alone exceeds what all of them do together
    if done:
        return done > 0
    innovation(f)
    first = 0
    for foot in range(e.sizes[FEET]):
        if e.does[foot] == STANDS:
            rows = 3 * (e.first[foot + 1] - e.first[foot])
            if not cholesky(f.S, first, rows, f.factor):
                return False
            if distance(f.factor, rows, f.r, first) > e.gates[foot]:
                e.does[foot], e.slips[foot] = LANDS, 1
            first += rows
    if not _choose(e, f, STANDS):
        return True
    innovation(f)
    return correct(f, inf) > 0


@kernel
def _land(e: Estimate, f: Filter) -> None:
    """Let the feet that landed or moved stand where they are seen, on the floor where there is one."""
    e.clock[NOW_HEIGHT] = e.clock[HEIGHT]
    m = _choose(e, f, LANDS)
    if not m:
        return
    place(f)
    if e.numbers[FLOOR2] < 0.0:
        return
    known, total = isfinite(e.clock[HEIGHT]), 0.0
    for part in range(1 if known else 0, 2):
        for foot in range(e.sizes[FEET]):
            if e.does[foot] == LANDS:
                for k in range(e.first[foot], e.first[foot + 1]):
                    if part == 0:
                        total += (dotted(e.up, f.d[k]) - e.radius[foot]) / m
                    else:
                        height = e.clock[NOW_HEIGHT] + e.radius[foot]
                        level(f, k, e.up, height, e.numbers[FLOOR2], e.numbers[FLOOR_GATE])
        if part == 0:
            e.clock[NOW_HEIGHT] = total


@kernel
def _smooth(e: Estimate) -> None:
    """The rates of base and joints, by their stationary Kalman filter."""
    dt = e.clock[STEP]
    for i in range(3, len(e.v)):
        e.now_a[i] = 0.0
        if not 0.0 < dt <= GAP:
            continue
        if i < 6:
            noise, agility = e.numbers[GYRO_NOISE] / sqrt(dt), e.numbers[GYRO_AGILITY]
        else:
            noise, agility = e.numbers[RATE_NOISE], e.numbers[RATE_AGILITY]
        if noise == 0.0:
            continue
        ratio = agility * dt * sqrt(dt) / noise
        r = 0.25 * (4.0 + ratio - sqrt(8.0 * ratio + ratio * ratio))
        alpha = 1.0 - r * r
        beta = 2.0 * (2.0 - alpha) - 4.0 * r
        first = e.v[i] + dt * e.a[i]
        off = e.now_v[i] - first
        e.now_v[i] = first + alpha * off
        e.now_a[i] = e.a[i] + beta / dt * off


@kernel
def _move_on(e: Estimate, f: Filter) -> None:
    """Where the robot is by now: the last accelerations went on."""
    late, q, v = e.numbers[LATE], e.out_q, e.out_v
    copy(e.q, q)
    copy(e.v, v)
    if late == 0.0:
        return
    for i in range(e.sizes[JOINTS]):
        q[7 + i] += late * (e.v[6 + i] + 0.5 * late * e.a[6 + i])
        v[6 + i] += late * e.a[6 + i]
    pull, fall, rate, turn = e.nine[:3], e.nine[3:6], e.nine[6:], e.six
    for i in range(3):
        turn[i] = late * (e.v[3 + i] + 0.5 * late * e.a[3 + i])
        rate[i] = e.v[3 + i] + late * e.a[3 + i]
        pull[i] = e.force[i] - f.bias[3 + i]
    for i in range(3):
        fall[i] = dotted(f.R[i], pull) + f.gravity[i]
    exponentials(turn, f.sums)
    square, vector = 0.25 * dotted(turn, turn), e.q[3:6]
    along, across = 1.0 - 0.5 * square, 0.5 - square / 12.0  # cosine and sine over angle of half the turn
    q[6] = along * e.q[6] - across * dotted(vector, turn)
    for i in range(3):
        after, before = (i + 1) % 3, (i + 2) % 3
        q[3 + i] = along * vector[i] + across * (
            e.q[6] * turn[i] + vector[after] * turn[before] - vector[before] * turn[after]
        )
    size = sqrt(dotted(q[3:6], q[3:6]) + q[6] * q[6])
    for i in range(4):
        q[3 + i] /= size
    # the speed of the base in the world, and then in the axes that it has by now
    for i in range(3):
        speed = dotted(e.base[i], e.v)
        pull[i] = speed + late * fall[i]
        q[i] += late * (speed + 0.5 * late * fall[i])
    for i in range(3):
        turn[3 + i] = e.base[0, i] * pull[0] + e.base[1, i] * pull[1] + e.base[2, i] * pull[2]
    for i in range(3):
        v[i] = f.sums[0, i] * turn[3] + f.sums[1, i] * turn[4] + f.sums[2, i] * turn[5]
        v[3 + i] = rate[i]


@entry
def foresee(at: int) -> int:
    """Move the filter on to the sample; kinematics are asked for at ``now_q``, ``now_v``, the base at the origin.

    Returns 0, or which part of the sample is bad, from 1: nothing has changed then.
    """
    e = _at(at)
    f = filter_at(e.sizes[FILTER])
    bad = _bad(e)
    if bad:
        return bad
    copy_estimate(f, False)
    clock = e.clock
    dt = clock[NOW] - clock[BEFORE] if isfinite(clock[BEFORE]) else 0.0
    clock[STEP] = dt
    for i in range(3):
        f.gyro[i], f.force[i] = e.gyro[i], e.force[i]
    if dt > GAP:
        long = min(dt, 10.0)
        for i in range(3):
            f.v[i] = 0.0
            e.nine[i] = (long * MISSED_RATE) ** 2
            e.nine[3 + i] = (long * MISSED_ACCELERATION) ** 2
            e.nine[6 + i] = (long * 0.5 * dt * MISSED_ACCELERATION) ** 2
        doubt(f, e.nine, f.p)
    elif dt > 0.0:
        predict(f, dt)
    for i in range(3):
        e.now_q[i] = e.now_v[i] = 0.0
    for i in range(e.sizes[JOINTS]):
        e.now_q[7 + i], e.now_v[6 + i] = e.joint_q[i], e.joint_v[i]
    _attitude(e, f)
    return 0


@entry
def settle(at: int) -> int:
    """Take up what feet and encoders say, with the kinematics in place: ``q``, ``v`` are the estimate then.

    Returns 0; 1 where numbers have lost their meaning: nothing has changed then.
    """
    e = _at(at)
    f = filter_at(e.sizes[FILTER])
    _press(e)
    _feel(e)
    _see(e, f)
    if isfinite(e.clock[BEFORE]):
        _roll(e, f)
    if not _stay(e, f):
        copy_estimate(f, True)
        return 1
    _land(e, f)
    foreseen = e.gram[:3, :3]
    for i in range(3):
        copy(e.base[i], foreseen[i])
    _attitude(e, f)
    _smooth(e)
    for i in range(3):
        arm, speed = 0.0, 0.0
        for j in range(3):
            arm += e.base[i, j] * e.lever[j]
            speed += e.base[j, i] * f.v[j]
        after, before = (i + 1) % 3, (i + 2) % 3
        e.now_q[i] = f.p[i] - arm
        e.now_v[i] = speed - (e.now_v[3 + after] * e.lever[before] - e.now_v[3 + before] * e.lever[after])
    sound = _finite(e.now_q) and _finite(e.now_v)
    for i in range(len(f.P)):
        sound = sound and _finite(f.P[i])
    if not sound:
        copy_estimate(f, True)
        return 1
    copy(e.now_q, e.q)
    copy(e.now_v, e.v)
    copy(e.now_a, e.a)
    copy(e.now_since, e.since)
    _remember(e, foreseen)
    for i in range(e.sizes[FEET]):
        e.touches[i] = 1 if e.does[i] else 0
    e.clock[BEFORE], e.clock[HEIGHT] = e.clock[NOW], e.clock[NOW_HEIGHT]
    _move_on(e, f)
    return 0
