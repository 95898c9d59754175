"""Files changed at random are read, or refused by a typed error; nothing else happens."""

from __future__ import annotations

import json
import tempfile
import warnings
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.models.test_hostile_files import GOOD
from wbc.control.recorder import Run
from wbc.errors import InvalidInput, ModelError, WbcError
from wbc.models import load
from wbc.qp import QP

FOLDER = Path(tempfile.mkdtemp(prefix="wbc-fuzz-"))
QP(np.eye(2), [1.0, 2.0], A=[[1.0, 1.0]], b=[1.0]).save(FOLDER / "qp.npz")
Run({"t": np.arange(3.0), "q": np.zeros((3, 2))}, {"scenario": "x", "dt": 0.1}).save(FOLDER / "run")
SOUND = {
    "robot.urdf": GOOD.encode(), "qp.npz": (FOLDER / "qp.npz").read_bytes(),
    "run.npz": (FOLDER / "run" / "run.npz").read_bytes(), "meta.json": (FOLDER / "run" / "meta.json").read_bytes(),
}  # fmt: skip


@st.composite
def spoilt(draw: st.DrawFn, content: bytes) -> bytes:
    """``content`` cut, repeated, or with bytes changed."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(0, len(data) - 1)))
        match draw(st.integers(0, 3)):
            case 0:
                data[place : place + draw(st.integers(1, 20))] = draw(st.binary(max_size=20))
            case 1:
                del data[place:]
            case 2:
                data[place:place] = data[: draw(st.integers(0, 200))]
            case _:
                data[place : place + 1] = draw(
                    st.sampled_from([b"<", b">", b"&", b'"', b"\0", b"nan", b"-9e999", b"{"])
                )
    return bytes(data)


@given(spoilt(SOUND["robot.urdf"]))
def test_robots(content: bytes):
    path = FOLDER / "robot.urdf"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            robot = load(path)
        except ModelError:
            return
    assert np.isfinite(robot.state().M).all()


@given(spoilt(SOUND["qp.npz"]))
def test_problems(content: bytes):
    path = FOLDER / "spoilt.npz"
    path.write_bytes(content)
    try:
        QP.load(path).check()
    except InvalidInput:
        return


@given(spoilt(SOUND["run.npz"]), spoilt(SOUND["meta.json"]), st.booleans())
def test_runs(arrays: bytes, meta: bytes, spoil_meta: bool):
    folder = FOLDER / "spoilt"
    folder.mkdir(exist_ok=True)
    (folder / "run.npz").write_bytes(SOUND["run.npz"] if spoil_meta else arrays)
    (folder / "meta.json").write_bytes(meta if spoil_meta else SOUND["meta.json"])
    try:
        run = Run.load(folder)
    except WbcError:
        return
    json.dumps(run.meta)
