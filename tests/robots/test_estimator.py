"""The estimate of a base: exact without errors, consistent with them, the same wherever the world begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import wbc
from tests.models.builders import joint, link, origin
from tests.robots.motions import (
    GRAVITY,
    NAMES,
    POINTS,
    QUIET,
    ROBOT,
    WEIGHT,
    Motion,
    errors,
    estimates,
    estimator,
    inverse,
    missed,
    moved_by,
    standing,
    stands,
    stepping,
    sums,
    turned,
)
from tests.seeds import generator
from wbc.models.catalogue import OWN_ROBOTS
from wbc.robots import SENSORS, BaseEstimator, ImuNoise
from wbc.types import Mat, Vec

NOISE = ImuNoise(
    gyro=5e-4, accelerometer=5e-3, gyro_bias=0.01, accelerometer_bias=0.1, gyro_walk=0, accelerometer_walk=0
)
JOINT = 1e-3


def followed(one: BaseEstimator, motion: Motion, start: Motion | None = None) -> tuple[Mat, Mat]:
    """(q, v) of every sample; it begins where ``start`` does."""
    rows = [(q, v) for _, q, v in estimates(one, motion, start)]
    return np.array([q for q, _ in rows]), np.array([v for _, v in rows])


@pytest.mark.parametrize("moves", [standing, stepping])
def test_without_errors_of_the_sensors_the_estimate_is_the_truth(moves: Callable[[], Motion]) -> None:
    assert np.abs(missed(estimator(), moves())).max() < 1e-9


def test_a_wrong_lean_and_speed_at_the_start_are_found() -> None:
    motion, one = standing(), estimator(tilt=0.05, speed=0.3, flex=1e-4)
    start = replace(motion, q=motion.q.copy(), v=motion.v.copy())
    start.q[0] = ROBOT.integrate(motion.q[0], np.array([0.0, 0.0, 0.0, 0.04, -0.03, *np.zeros(13)]))
    start.v[0, :3] += [0.2, -0.1, 0.1]
    q, v = followed(one, motion, start)
    first, last = (np.abs(errors(q[k], v[k], motion.q[k], motion.v[k])) for k in (0, -1))
    assert first[3:5].min() > 0.02 and first[6:].min() > 0.05, "nothing was wrong at the start"
    assert last[3:5].max() < 1e-3 and last[6:].max() < 2e-3


@settings(max_examples=5, deadline=None)
@given(st.floats(-3.0, 3.0), st.tuples(*[st.floats(-20.0, 20.0)] * 3))
def test_the_estimate_turns_and_shifts_with_the_world(heading: float, shift: tuple[float, float, float]) -> None:
    motion = stepping(duration=0.6)
    noisy = motion.with_noise(generator("noise"), 5e-4, 5e-3, JOINT, np.full(6, 0.01))
    one = estimator(noise=NOISE, joint=JOINT)
    here, v_here = followed(one, noisy, motion)
    known = one.covariance
    there, v_there = followed(one, noisy, turned(motion, heading, np.array(shift)))
    expected = turned(replace(motion, q=here), heading, np.array(shift)).q
    assert np.abs(v_there - v_here).max() < 1e-8
    for got, wanted in zip(there, expected, strict=True):
        assert np.abs(errors(got, v_here[0], wanted, v_here[0])[:6]).max() < 1e-8
    turn = np.kron(np.eye(3), Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix())
    assert np.abs(turn @ known @ turn.T - one.covariance).max() < 1e-6 * np.abs(known).max()


def test_position_and_heading_are_never_claimed_to_be_seen() -> None:
    """Their uncertainty at the start stays to the end, whatever noise does to the estimates that others depend on."""
    motion = stepping(duration=1.0)
    noisy = motion.with_noise(generator("unseen"), 5e-4, 5e-3, JOINT, np.full(6, 0.01))
    one, least = estimator(noise=NOISE, joint=JOINT), np.array([0.5, 0.4, 0.3, 0.3]) ** 2
    one.reset(motion.q[0], motion.v[0])
    one._filter.P[range(6, 9), range(6, 9)] += least[:3]
    one._filter.P[2, 2] += least[3]  # the whole world is turned, its velocities too
    for k in range(len(motion.t)):
        one.update(**noisy.sample(k))
        diagonal = np.diag(one.covariance)
        assert (diagonal[[0, 1, 2, 5]] >= least * (1.0 - 1e-9)).all()
    assert (diagonal[3:5] < 0.02**2).all() and (diagonal[6:] < 0.05**2).all(), "nothing was learnt of what can be seen"


@pytest.mark.slow
def test_errors_are_as_large_as_the_covariance_says() -> None:
    """NEES of lean and velocity over 60 seeds: χ² with 5 degrees of freedom each, errors of the start drawn too."""
    motion = stepping(5e-3, 1.0)
    one = estimator(noise=NOISE, joint=JOINT, flex=1e-5, creep=0.0, sink=0.0, tilt=0.02, speed=0.05)
    seen, seeds = [3, 4, 6, 7, 8], 60
    total, biases = 0.0, 0.0
    for seed in range(seeds):
        rng = generator("NEES", seed)
        bias = np.repeat([NOISE.gyro_bias, NOISE.accelerometer_bias], 3) * rng.standard_normal(6)
        noisy = motion.with_noise(rng, NOISE.gyro, NOISE.accelerometer, JOINT, bias)
        lean = np.array([*rng.normal(0.0, 0.02, 2), 0.0])
        start_q = motion.q[0].copy()
        start_q[3:7] = (Rotation.from_rotvec(lean) * Rotation.from_quat(start_q[3:7])).as_quat()
        start_v = motion.v[0].copy()
        world = Rotation.from_quat(motion.q[0, 3:7]).apply(start_v[:3]) + rng.normal(0.0, 0.05, 3)
        start_v[:3] = Rotation.from_quat(start_q[3:7]).inv().apply(world)
        q, v = followed(one, noisy, replace(motion, q=start_q[None], v=start_v[None]))
        error = errors(q[-1], v[-1], motion.q[-1], motion.v[-1])[seen]
        total += error @ np.linalg.solve(one.covariance[np.ix_(seen, seen)], error)
        off = one.gyro_bias - bias[:3]
        biases += off @ np.linalg.solve(one._filter.P[9:12, 9:12], off)
    for found, freedom in ((total, 5 * seeds), (biases, 3 * seeds)):
        low, high = chi2.ppf([5e-4, 1.0 - 5e-4], freedom)
        assert low < found < high, f"NEES {found / seeds:.2f} a run"


def test_biases_are_found_by_a_robot_that_turns() -> None:
    motion = moved_by(stands, 6.0, 5e-3, turns=2.0)
    bias = np.array([0.02, -0.015, 0.01, 0.1, -0.08, 0.12])
    noisy = motion.with_noise(generator("biases"), 1e-4, 1e-3, 2e-4, bias)
    noise = ImuNoise(1e-4, 1e-3, 0.02, 0.1, 1e-6, 1e-5)
    one = estimator(noise=noise, joint=2e-4, flex=1e-4)
    followed(one, noisy, motion)
    assert np.abs(one.gyro_bias - bias[:3]).max() < 2e-3
    assert np.abs(one.accelerometer_bias - bias[3:]).max() < 0.03


def leaning_by_its_accelerometer(stone: float = 0.0, **settings: Any) -> tuple[float, float]:
    """Errors of lean [rad] and height [m] where steps are made with a bias of 0.2 m/s² that nobody knows of.

    One foot of the first pair that swings lands on a stone.
    """
    bias = np.array([0.0, 0.0, 0.0, 0.2, -0.2, 0.0])

    def feet(t: float) -> tuple[Mat, list[bool]]:
        lifted = np.zeros((4, 3))
        on = [True] * 4
        for k, start in enumerate(np.arange(0.2, 1.7, 0.4)):
            pair = (0, 3) if k % 2 == 0 else (1, 2)
            if start < t < start + 0.2:
                for i in pair:
                    lifted[i, 2], on[i] = 0.03 * np.sin(np.pi * (t - start) / 0.2), False
        if t >= 0.4 and on[0]:
            lifted[0, 2] = stone
        return lifted, on

    motion = moved_by(feet, 2.0, 2e-3)
    one = estimator(noise=ImuNoise(1e-4, 1e-3, 1e-3, 0.2), flex=1e-4, **settings)
    found = missed(one, motion.with_noise(generator("floor"), 1e-4, 1e-3, 0.0, bias), motion)[200:]
    return float(np.abs(found[:, 3:5]).max()), float(np.abs(found[:, 2]).max())


def test_a_level_floor_tells_a_lean_from_a_bias_of_the_accelerometer() -> None:
    lean, height = leaning_by_its_accelerometer(floor=2e-4)
    blind, _ = leaning_by_its_accelerometer()
    assert lean < 1e-3 and height < 1e-3
    assert blind > 5.0 * lean, "nothing was to be told apart"


def test_a_foot_on_a_stone_does_not_tilt_the_floor() -> None:
    lean, height = leaning_by_its_accelerometer(stone=0.02, floor=2e-4)
    assert lean < 2e-3 and height < 2e-3
    tilted, _ = leaning_by_its_accelerometer(stone=0.02, floor=2e-4, gate=0.0)
    assert tilted > 3.0 * lean, "the stone would not have been felt"


def test_an_estimate_of_late_samples_is_moved_on_to_now() -> None:
    motion, late = standing(1e-3, 1.0), 4
    found = {}
    for told in (0.0, late * 1e-3):
        q, v = followed(estimator(noise=ImuNoise(0.0, 1e-5, 0.0, 0.0, 0.0, 0.0), late=told), motion)
        found[told] = np.array([errors(*row) for row in zip(q, v, motion.q[late:], motion.v[late:], strict=False)])
    first, then = (np.abs(found[told][20:]).max(axis=0) for told in found)
    assert (then[:6] < 0.02 * first[:6].max()).all() and (then[6:] < 0.1 * first[6:].max()).all()


def test_rates_without_noise_come_back_as_they_are_and_noise_is_filtered_without_lag() -> None:
    """A ramp of a joint's rate is followed without error; white noise is halved."""
    one, rest = estimator(joint_rate=0.01), {"gyro_in_imu": np.zeros(3), "acceleration_in_imu": -GRAVITY}
    one.reset(ROBOT.q0, np.zeros(18))
    rng, rates = generator("rates"), []
    for k in range(1000):
        ramp = 1e-3 * k
        said = ramp + np.array([0.0, *(0.01 * rng.standard_normal(11))])
        rates.append(one.update(1e-3 * k, ROBOT.q0[7:], said, **rest)[1][6:] - ramp)
    late = np.array(rates)[300:]
    assert abs(late[:, 0]).max() < 1e-9
    assert late[:, 1:].std() < 0.005


# ---- feet
def slipping(way: float, begin: float, end: float) -> Motion:
    """One foot slides by ``way`` [m] and goes on pressing."""

    def feet(t: float) -> tuple[Mat, list[bool]]:
        moved = np.zeros((4, 3))
        moved[0, 1] = way * np.clip((t - begin) / (end - begin), 0.0, 1.0)
        return moved, [True] * 4

    return moved_by(feet, 1.0, 2e-3)


@pytest.mark.parametrize("way", [0.02, 0.04])
def test_a_foot_that_slips_is_named_and_does_not_take_the_base_along(way: float) -> None:
    motion = slipping(way, 0.4, 0.5)
    noisy = motion.with_noise(generator("slip"), 2e-4, 1e-3, 2e-4, np.zeros(6))
    found: dict[float, Vec] = {}
    for gate in (1e-6, 0.0):
        one = estimator(noise=ImuNoise(gyro_bias=1e-3, accelerometer_bias=0.02), joint=2e-4, gate=gate)
        rows = [(one.why, errors(q, v, motion.q[k], motion.v[k])) for k, q, v in estimates(one, noisy, motion)]
        said, found[gate] = [why for why, _ in rows], rows[-1][1]
        slips = [motion.t[k] for k, why in enumerate(said) if "slips" in why]
        assert all(0.4 <= t <= 0.52 for t in slips)
        assert {why for why in said if why} == ({f"{NAMES[0]} slips"} if gate else set())
    with_gate, without = (np.abs(found[gate][:3]).max() for gate in (1e-6, 0.0))
    assert with_gate < 0.1 * way, f"the base went along by {with_gate * 1e3:.1f} mm"
    assert without > 2.0 * with_gate, "the slip was not felt"


def test_a_foot_that_lands_early_is_used_from_then_on() -> None:
    """No schedule is asked: force alone says that a foot stands, also when it comes 60 ms before its time."""

    def feet(t: float) -> tuple[Mat, list[bool]]:
        moved = np.zeros((4, 3))
        moved[0, 2] = 0.03 * np.sin(np.pi * np.clip((t - 0.2) / 0.2, 0.0, 0.7))  # stands on something high from 0.34 s
        if t < 0.2:
            moved[0, 2] = 0.0
        return moved, [not 0.2 < t < 0.34, True, True, True]

    motion, one = moved_by(feet, 0.8, 2e-3), estimator(settle=5e-3)
    rows = [(one.contacts[NAMES[0]], q, v) for _, q, v in estimates(one, motion)]
    touched, (_, q, v) = [touches for touches, *_ in rows], rows[-1]
    landed = next(t for t, before, now in zip(motion.t[1:], touched, touched[1:], strict=False) if now and not before)
    assert 0.34 <= landed <= 0.35
    assert np.abs(errors(q, v, motion.q[-1], motion.v[-1])).max() < 1e-8
    assert one.why == ""


def test_a_ball_that_rolls_does_not_slip() -> None:
    """The trunk swings to and fro over round feet; the centre of each ball goes by r θ × z."""
    motion = rolled(0.02)
    found = {}
    for radius in (0.02, 0.0):
        one = estimator(feet=[replace(foot, radius=radius) for foot in POINTS])
        found[radius] = np.abs(missed(one, motion)[:, :3]).max()
    assert found[0.02] < 2e-5
    assert found[0.0] > 20.0 * found[0.02], "the feet hardly rolled"


@pytest.mark.parametrize("radius", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("tilt", [0.005, 0.02, 0.1])
def test_a_correction_of_the_lean_is_no_roll(radius: float, tilt: float) -> None:
    """A robot that stands still is taken to lean by no more than the covariance allows, on whatever feet."""
    noise, dt = ImuNoise(gyro_bias=0.0, accelerometer_bias=0.0), 1e-3
    round_feet = [replace(foot, radius=radius) for foot in POINTS]
    q, rest = ROBOT.q0, np.zeros(ROBOT.nv)
    white = np.repeat([noise.gyro, noise.accelerometer], 3) / np.sqrt(dt)
    for seed in range(3):
        one, rng = BaseEstimator(ROBOT, round_feet, noise=noise, tilt=tilt), np.random.default_rng(seed)
        one.reset(q, rest)
        for k in range(100):
            felt = white * rng.standard_normal(6) + [0.0, 0.0, 0.0, *-GRAVITY]
            lean = errors(*one.update(k * dt, q[7:], rest[6:], felt[:3], felt[3:]), q, rest)[3:5]
            assert lean @ np.linalg.solve(one.covariance[3:5, 3:5], lean) < chi2.isf(1e-6, 2) and not one.why


def rolled(radius: float) -> Motion:
    """A motion whose feet have rolled: each step is solved again until centres and rotations agree."""
    motion = standing(duration=1.0)
    state = ROBOT.state()
    q, v = motion.q.copy(), motion.v.copy()
    state.update(0.0, q[0], v[0])
    centres = np.array([np.array(state.frame(name).position) for name in NAMES])
    turns = [Rotation.from_matrix(state.frame(name).rotation) for name in NAMES]
    for k in range(1, len(q)):
        base, aim = Rotation.from_quat(q[k, 3:7]).as_matrix(), centres
        for _ in range(6):
            q[k, 7:] = inverse(base, q[k, :3], aim, q[k - 1, 7:])
            state.update(0.0, q[k], v[k])
            now = [Rotation.from_matrix(state.frame(name).rotation) for name in NAMES]
            theta = np.array([(b * a.inv()).as_rotvec() for a, b in zip(turns, now, strict=True)])
            aim = centres + radius * np.cross(theta, [0.0, 0.0, 1.0])
        centres, turns = aim, now
    return replace(motion, q=q)


def test_touching_has_a_hysteresis_and_must_last() -> None:
    one = BaseEstimator(ROBOT, make=0.05, break_=0.025, settle=5e-3)
    one.reset(ROBOT.q0, np.zeros(18))
    told = {0: 0.06, 1: 0.03, 10: 0.02, 11: 0.04, 20: 0.06, 22: 0.04, 30: 0.06, 36: 0.03}
    wanted = {0: True, 9: True, 10: False, 19: False, 25: False, 34: False, 35: True, 40: True}
    share = 0.0
    for k in range(41):
        share = told.get(k, share)
        forces = dict.fromkeys(NAMES, share * WEIGHT)
        one.update(1e-3 * k, ROBOT.q0[7:], np.zeros(12), np.zeros(3), -GRAVITY, forces=forces)
        if k in wanted:
            assert set(one.contacts.values()) == {wanted[k]}, f"at {k} ms"


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_torques_that_hold_a_standing_robot_tell_which_feet_stand(name: str) -> None:
    robot = wbc.load(name)
    state = robot.state()
    J = np.vstack([state.frame(foot).jacobian()[: 3 if one.kind == "point" else 6] for foot, one in robot.feet.items()])
    size = len(J) // len(robot.feet)
    for lifted in (False, True):
        rows = np.arange(len(J)) >= size * lifted
        f = np.zeros(len(J))
        f[rows] = np.linalg.lstsq(J[rows, :6].T, state.h[:6], rcond=None)[0]
        assert np.allclose(J[:, :6].T @ f, state.h[:6]), "the robot falls"
        one, tau = BaseEstimator(robot), (state.h - J.T @ f)[6:]
        for t in (0.0, 0.01):
            one.update(t, robot.q0[7:], np.zeros(robot.nj), np.zeros(3), -GRAVITY, joint_tau=tau)
        assert list(one.contacts.values()) == (f[2::size] > 0.05 * 9.81 * robot.mass).tolist()
        assert next(iter(one.contacts.values())) != lifted


@pytest.mark.filterwarnings("ignore::wbc.models.feet.Guessed")
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lever", [np.zeros(3), np.array([0.1, -0.05, 0.08])], ids=["in it", "beside it"])
def test_an_imu_tells_the_same_wherever_it_is_mounted(lever: Vec, seed: int, tmp_path: Path) -> None:
    """A robot whose file has the IMU at a place of its own, turned, with what it feels there."""
    angles = generator("a turned IMU", seed).uniform(-np.pi, np.pi, 3)
    more = link("imu") + joint("mount", "trunk", "imu", "fixed", origin(lever, angles))
    path, text = tmp_path / "quadruped.urdf", (OWN_ROBOTS / "quadruped.urdf").read_text(encoding="utf-8")
    path.write_text(text.replace("</robot>", f"{more}</robot>"), encoding="utf-8")
    robot, motion = wbc.load(path, base="floating", q0=ROBOT.q0), stepping(duration=0.5)
    mount, R = Rotation.from_euler("xyz", angles).as_matrix(), Rotation.from_quat(motion.q[:, 3:7]).as_matrix()
    gyro, force = motion.gyro @ mount, motion.force.copy()
    points, dt = motion.q[:, :3] + R @ lever, float(motion.t[1])
    # v of the IMU by the trapezoid that its positions make, then what it feels between
    v = [R[0] @ (motion.v[0, :3] + np.cross(motion.v[0, 3:6], lever))]
    for k in range(1, len(R)):
        _, first, second = sums(dt * gyro[k])
        turn = R[k - 1] @ mount
        push = (points[k] - points[k - 1] - dt * v[-1]) / dt**2 - 0.5 * GRAVITY
        force[k] = np.linalg.solve(turn @ second, push)
        v.append(v[-1] + dt * (turn @ first @ force[k] + GRAVITY))
    force[0] = force[0] @ mount
    one = estimator(robot, noise=replace(QUIET, accelerometer_range=1e9), imu_frame="imu")
    off = np.abs(missed(one, replace(motion, gyro=gyro, force=force), motion))
    assert off[:, :6].max() < 1e-8 if lever.any() else off.max() < 1e-9


def test_the_covariance_stays_one_in_a_long_run() -> None:
    one = BaseEstimator(ROBOT)
    for k in range(5_000):
        one.update(1e-3 * k, ROBOT.q0[7:], np.zeros(12), np.zeros(3), -GRAVITY)
    P = one._filter.P
    assert np.abs(P - P.T).max() <= 1e-12 * np.abs(P).max()
    assert np.linalg.eigvalsh(P)[0] > -1e-12 * np.abs(P).max()
    assert np.abs(one._filter.R @ one._filter.R.T - np.eye(3)).max() < 1e-12


def test_the_rate_of_a_base_that_a_leg_swings_is_not_late():
    """A step of a humanoid turns its base by up to 0.25 rad/s, 1.4 times a second; what is late moves the foot."""
    one, off, in_the_air = BaseEstimator(ROBOT, noise=SENSORS["mti-300"].imu), [], dict.fromkeys(NAMES, 0.0)
    one.reset(ROBOT.q0, np.zeros(ROBOT.nv))
    for t in np.arange(1e-3, 1.0, 1e-3):
        rate = np.array([0.0, 0.25 * np.sin(2.0 * np.pi * 1.4 * t), 0.0])
        _, v = one.update(t, ROBOT.q0[7:], np.zeros(12), rate, -GRAVITY, forces=in_the_air)
        off.append(abs(v[4] - rate[1]))
    assert max(off[200:]) < 3e-3
