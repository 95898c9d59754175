"""The engine runs without pictures, without a log file, and without being asked for by those who do not simulate."""

from __future__ import annotations

import logging
import subprocess
import sys

import pytest

from wbc.errors import SimulationError
from wbc.sim import engine


def run_python(script, **arguments):
    """What a fresh interpreter prints."""
    result = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True, **arguments)
    return result.stdout.strip()


def test_without_the_engine_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SimulationError, match=r"the physics engine cannot be imported .* pip install mujoco"):
        engine.mujoco()


def test_plants_and_disturbances_load_no_engine():
    script = "import sys, wbc.sim.simulate, wbc.sim.mujoco_, wbc.sim.disturbance; print('mujoco' in sys.modules)"
    assert run_python(script) == "False"


@pytest.mark.physics
def test_physics_loads_no_graphics_and_leaves_the_environment_alone():
    pytest.importorskip("mujoco")
    script = (
        "import os, sys; os.environ.pop('MUJOCO_GL', None)\n"
        "from wbc.sim.engine import mujoco; mujoco()\n"
        "graphics = {'glfw', 'OpenGL', 'mujoco.egl', 'mujoco.osmesa', 'mujoco.glfw'}\n"
        "print(sorted(graphics & set(sys.modules)), os.environ.get('MUJOCO_GL'))"
    )
    assert run_python(script) == "[] None"


@pytest.mark.physics
def test_warnings_of_the_engine_go_to_the_log_of_the_program(tmp_path, monkeypatch, caplog):
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    assert engine.mujoco() is mujoco
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[0] = float("nan")
    with caplog.at_level(logging.WARNING, logger="wbc.sim.mujoco"):
        mujoco.mj_step(model, data)
    assert "QVEL" in caplog.text
    assert list(tmp_path.iterdir()) == []
