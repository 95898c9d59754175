"""Masses and moments that no rigid body has are warned about by the name of the link, and loaded as they are."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.builders import inertial, joint, link, origin, saved
from wbc.errors import ModelError
from wbc.models import load
from wbc.models.catalogue import EXAMPLES, OWN, example_robots
from wbc.models.plausible import ImplausibleInertia

SOUND = (1.5, (0.1, 0.1, 0.1))


def robot_of(folder: Path, **links: tuple[float, tuple[float, float, float]]) -> Path:
    """A fixed base, a link "forearm" that moves, and the link "tool" fixed to it; (mass, diagonal of the inertia)."""
    links = {"base": SOUND, "forearm": SOUND, "tool": SOUND} | links
    parts = [link(name, inertial(mass, moments, origin("0.1 0 0.1"))) for name, (mass, moments) in links.items()]
    joints = joint("elbow", "base", "forearm"), joint("flange", "forearm", "tool", "fixed")
    return saved(folder, *parts, *joints, name="odd")


@pytest.mark.parametrize(
    ("mass", "moments", "sentence"),
    [
        (1.5, (0.1, 0.1, 0.3), "link 'forearm' has principal moments .* larger than the sum"),
        (1.5, (0.9, 0.1, 0.1), "link 'forearm' has principal moments .* larger than the sum"),
        (1.5, (0.0, 0.0, 0.0), "link 'forearm' has a mass of 1.5 kg and no inertia"),
        (1.5, (1e-16, 1e-16, 1e-16), "link 'forearm' has a mass of 1.5 kg and no inertia"),
        (0.0, (0.1, 0.1, 0.1), "link 'forearm' has no mass, but principal moments"),
        (1.5, (1e5, 1e5, 1e5), "link 'forearm' has a mass of 1.5 kg and .* kg mm²"),
    ],
)
@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_what_no_body_has_is_said(
    tmp_path: Path, mass: float, moments: tuple[float, float, float], sentence: str, base: str
):
    path = robot_of(tmp_path, forearm=(mass, moments), tool=(0.0, (0.0, 0.0, 0.0)))
    with pytest.warns(ImplausibleInertia, match=f"^odd: {sentence}") as said:
        robot = load(path, base=base)
    assert [warning.filename for warning in said] == [__file__]
    assert np.isfinite(robot.state().M).all()


def test_the_base_counts_where_it_moves(tmp_path: Path):
    path = robot_of(tmp_path, base=(1.0, (0.1, 0.1, 0.5)))
    load(path)
    with pytest.warns(ImplausibleInertia, match="link 'base' has principal moments"):
        load(path, base="floating")


def test_a_mass_that_is_fixed_to_a_body_need_not_be_a_body(tmp_path: Path):
    assert load(robot_of(tmp_path, tool=(0.2, (0.0, 0.0, 0.0)))).mass == pytest.approx(1.7)


@given(
    st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=4, max_size=12),
    st.lists(st.floats(0.01, 5.0), min_size=12, max_size=12),
)
def test_bodies_of_points_are_not_doubted(tmp_path_factory: pytest.TempPathFactory, points, masses):
    """Any points that lie in no line, however flat: their moments are written with three digits, as in files."""
    x = np.array(points)
    m = np.array(masses[: len(x)])
    x = x - (m @ x) / m.sum()
    spread = (x * m[:, None]).T @ x
    values = np.sort(np.linalg.eigvalsh(np.trace(spread) * np.eye(3) - spread))
    if values[2] < 1e-6:
        return
    moments = tuple(float(f"{max(v, 0.0):.2e}") for v in values)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(robot_of(tmp_path_factory.mktemp("points"), forearm=(float(m.sum()), moments), tool=(0.0, (0.0,) * 3)))


def examples() -> list[str]:
    try:
        example_robots()
    except ModelError:
        return []
    return [name for name in EXAMPLES if name != "icub"]


@pytest.mark.parametrize("name", [*OWN, *examples()])
def test_no_robot_of_the_table_is_doubted(name: str):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", ImplausibleInertia)
        load(name)


def test_icub_as_its_file_has_it_is_doubted():
    if not examples():
        pytest.skip("example-robot-data is not installed")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        load("icub")
    sentence = next(str(w.message) for w in said if issubclass(w.category, ImplausibleInertia))
    assert "link 'r_hip_1' has a mass of 0.754 kg and no inertia" in sentence
