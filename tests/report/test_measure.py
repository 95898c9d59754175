"""The numbers in a report: read from the run, in its units, and missing where the run does not have them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.report import measure

from .conftest import DT, FRICTION, HALF_SIZE, reaching_run, standing_run


def test_a_run_inside_its_limits_breaks_none():
    broken = measure.violations(standing_run())
    assert set(broken) == {"torque", "joint velocity", "joint position", "commanded wrench"}
    assert {worst for worst, _ in broken.values()} == {0.0}


@given(excess=st.floats(1e-6, 50.0), joint=st.integers(0, 29), row=st.integers(0, 119))
def test_a_broken_limit_is_reported_by_how_much(excess: float, joint: int, row: int):
    run = standing_run()
    bound = measure.limits(run)
    run.columns["tau"][row, joint] = -bound["tau_max"][joint] - excess
    run.columns["plant.v"][row, 6 + joint] = bound["v_max"][joint] + excess
    run.columns["plant.q"][row, 7 + joint] = bound["q_min"][joint] - excess
    broken = measure.violations(run)
    for kind, unit in (("torque", "N m"), ("joint velocity", "rad/s"), ("joint position", "rad")):
        assert broken[kind] == (pytest.approx(excess), unit)


@given(excess=st.floats(1e-6, 50.0), joint=st.integers(0, 29))
def test_a_limit_of_a_sliding_joint_is_broken_by_metres_and_newtons(excess: float, joint: int):
    run = standing_run()
    run.meta["joint_units"] = ["m" if i == joint else "rad" for i in range(30)]
    bound = measure.limits(run)
    run.columns["tau"][3, joint] = bound["tau_max"][joint] + excess
    run.columns["plant.v"][3, 6 + joint] = bound["v_max"][joint] + excess
    run.columns["plant.q"][3, 7 + joint] = bound["q_max"][joint] + excess
    broken = measure.violations(run)
    for kind, unit in (("torque", "N"), ("joint velocity", "m/s"), ("joint position", "m")):
        assert broken[kind] == (pytest.approx(excess), unit)


@given(joint=st.integers(0, 29), kind=st.sampled_from(["torque", "joint velocity", "joint position"]))
def test_a_kept_limit_has_the_unit_of_the_joint_that_came_nearest(joint: int, kind: str):
    run = standing_run()
    run.meta["joint_units"] = ["m" if i == joint else "rad" for i in range(30)]
    bound = measure.limits(run)
    run.columns["tau"][3, joint] = bound["tau_max"][joint] - 1e-9
    run.columns["plant.v"][3, 6 + joint] = bound["v_max"][joint] - 1e-9
    run.columns["plant.q"][3, 7 + joint] = bound["q_max"][joint] - 1e-9
    found = measure.excesses(run)[kind]
    assert measure.place(run, found.values, 0.0, found.parts).part == run.meta["joint_names"][joint]
    assert measure.violations(run)[kind] == (0.0, found.units[joint]) and found.units.count(found.units[joint]) == 1


def test_a_commanded_force_outside_its_cone_is_reported_in_newton():
    run = standing_run()
    run.columns["f.Sole[left_sole]"][3] = [FRICTION * 100.0 + 7.0, 0.0, 100.0, 0.0, 0.0, 0.0]
    assert measure.violations(run)["commanded wrench"] == (pytest.approx(7.0), "N")


def test_the_error_of_a_task_is_read_by_unit():
    parts = measure.errors(standing_run(), "Frame[left_hand]")
    assert {unit: part.shape for unit, part in parts.items()} == {"m": (120, 3), "rad": (120, 3)}
    tracking = measure.tracking(standing_run())
    assert tracking["Frame[left_hand]"]["max"] == pytest.approx(3**0.5 * 2e-3)
    assert tracking["Frame[left_hand] [rad]"]["rms"] == pytest.approx(3**0.5 * 4e-3)


@given(st.lists(st.booleans(), min_size=120, max_size=120))
def test_rms_is_at_most_the_maximum_over_any_part_of_a_run(keep: list[bool]):
    for value in measure.tracking(standing_run(), keep=np.array(keep)).values():
        assert np.isnan(value["rms"]) or value["rms"] <= value["max"] * (1 + 1e-12)


@given(st.lists(st.booleans(), min_size=120, max_size=120))
def test_pushes_cover_exactly_the_rows_with_a_force(on: list[bool]):
    run = standing_run()
    run.columns["push"][:] = np.array(on)[:, None] * [0.0, 3.0, 0.0]
    covered = np.zeros(120, dtype=bool)
    for start, end in measure.pushes(run):
        covered[round(start / DT) : round(end / DT)] = True
    assert covered.tolist() == on


def test_the_centre_of_pressure_is_where_the_moments_put_it():
    run = standing_run()
    where = np.array([0.03, -0.02])
    run.columns["f.Sole[left_sole]"][:] = [0, 0, 200.0, 200.0 * where[1], -200.0 * where[0], 0]
    track = measure.contact_track(run, "Sole[left_sole]", true=False)
    assert track is not None and track.cop is not None
    assert np.allclose(track.cop, where)
    assert np.all(np.abs(track.cop) <= HALF_SIZE)


def test_an_unloaded_contact_has_no_ratio_and_no_centre_of_pressure():
    run = standing_run()
    run.columns["plant.f.Sole[left_sole]"][5] = 0.0
    track = measure.contact_track(run, "Sole[left_sole]", true=True)
    assert track is not None and track.cop is not None
    assert np.isnan(track.ratio[5]) and np.isnan(track.cop[5]).all() and np.isfinite(track.ratio[6])


def test_ratios_are_those_of_the_circular_cone():
    run = standing_run()
    for column in ("f.Sole[left_sole]", "plant.f.Sole[left_sole]"):
        run.columns[column][:] = [3.0, 4.0, 10.0, 0, 0, 0]
    tracks = [measure.contact_track(run, "Sole[left_sole]", true=true) for true in (False, True)]
    assert [float(track.ratio[0]) for track in tracks if track] == pytest.approx([0.5, 0.5])


def test_a_limit_of_zero_in_a_model_counts_as_none():
    run = standing_run()
    run.meta["limits"] = {**run.meta["limits"], "v_max": [0.0] * 30, "tau_max": [float("inf")] * 30}
    assert measure.use(run)["velocity"].max() == 0.0
    assert measure.use(run)["torque"].max() == 0.0


def test_statuses_are_counted_by_their_name():
    assert measure.statuses(standing_run()) == {"SOLVED": 119, "INFEASIBLE": 1}


def test_a_kinematic_run_has_no_torques_and_no_forces():
    run = reaching_run()
    assert "torque" not in measure.use(run) and set(measure.violations(run)) == {"joint velocity", "joint position"}
    assert measure.pushes(run) == [] and measure.contact_track(run, "none", true=True) is None
    assert measure.slip(run, "none") is None


def test_a_place_is_where_a_bound_is_first_broken_or_else_nearest():
    run = standing_run()
    values = np.zeros((run.rows, 2))
    values[40, 1], values[60, 0] = 2.0, 3.0
    assert measure.place(run, values, 1.0, ("left", "right"), "p") == (pytest.approx(0.4), "right", "p")
    assert str(measure.place(run, values, 5.0, ("left", "right"))) == "t = 0.600 s, left"
    assert measure.place(run, np.full((run.rows, 2), np.nan), 1.0, ("left", "right"), "p") == (None, "", "p")


def test_the_place_of_a_broken_limit_names_the_joint():
    run = standing_run()
    joint = run.meta["joint_names"].index("left_knee")
    run.columns["plant.v"][33, 6 + joint] = 1e3
    excess = measure.excesses(run)["joint velocity"]
    assert measure.place(run, excess.values, 0.0, excess.parts).part == "left_knee"


def test_ticks_longer_than_the_period_are_late():
    run = standing_run()
    run.columns["tick_us"][[3, 5]] = 1e6 * DT + 1.0
    assert measure.late(run) == 2
