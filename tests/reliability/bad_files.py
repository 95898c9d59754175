"""Bad files: URDF, QPs, runs and parameters that are not what they should be, or want what is not theirs."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import wbc
from tests.models.test_hostile_files import BOMB, GOOD, HOSTILE
from tests.reliability.forked import Case
from wbc.control.recorder import Run
from wbc.qp import QP
from wbc.sim.scenario import find


def written(name: str, content: bytes) -> Path:
    """A file of this content in a folder of its own."""
    path = Path(tempfile.mkdtemp(prefix="wbc-bad-")) / name
    path.write_bytes(content)
    return path


def archive(**arrays: bytes) -> bytes:
    """A zip of these members, compressed."""
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in arrays.items():
            file.writestr(f"{name}.npy", content)
    return memory.getvalue()


def npy(array: object) -> bytes:
    memory = io.BytesIO()
    np.save(memory, array, allow_pickle=True)  # type: ignore[arg-type]
    return memory.getvalue()


def promising(shape: str, dtype: str = "<f8") -> bytes:
    """An array that says it is of this shape, and is not there."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def sound() -> dict[str, bytes]:
    """The members of a sound QP file."""
    qp = QP(np.eye(2), [1.0, 2.0], A=[[1.0, 1.0]], b=[1.0])
    path = written("qp.npz", b"")
    qp.save(path)
    with zipfile.ZipFile(path) as file:
        return {name.removesuffix(".npy"): file.read(name) for name in file.namelist()}


class Evil:
    """What runs when a pickle is read."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (print, ("a pickle was read",))


def run_folder(arrays: bytes, meta: bytes = b"{}") -> Path:
    path = written("run.npz", arrays)
    (path.parent / "meta.json").write_bytes(meta)
    return path.parent


def cases() -> Iterator[Case]:
    """Bad inputs of this kind."""
    for name, (content, sentence) in HOSTILE.items():
        data = content if isinstance(content, bytes) else content.encode()
        yield Case(f"URDF, {name}", lambda solver, data=data: wbc.load(written("robot.urdf", data)), (sentence,))
    yield Case("URDF, a sound one", lambda solver: wbc.load(written("robot.urdf", GOOD.encode())).name)
    bomb = (BOMB + GOOD).encode()
    yield Case("URDF, bomb of a billion", lambda solver: wbc.load(written("robot.urdf", bomb)), ("document type",))
    for place in ("/dev/zero", "/etc", "/proc/self/mem", "/nowhere.urdf"):
        yield Case(f"URDF, {place}", lambda solver, place=place: wbc.load(Path(place)), ("file",))
    yield Case("URDF, a name with a nul", lambda solver: wbc.load("robot\0.urdf"), ("robot",))

    bad: dict[str, bytes] = {
        "nothing": b"", "text": b"hello", "half": archive(**sound())[:200], "no member": archive(),
        "one member": archive(H=sound()["H"]), "a pickle": archive(**{**sound(), "H": npy(np.array([Evil()], object))}),
        "a pickle alone": npy(np.array([Evil()], object)),
        "petabytes": archive(**{**sound(), "H": promising("(1000000000, 1000000)")}),
        "negative size": archive(**{**sound(), "H": promising("(-1, 2)")}),
        "gigabytes of zeros": archive(**{**sound(), "H": promising("(30000, 30000)") + bytes(200_000_000)}),
        "another shape": archive(**{**sound(), "g": npy(np.zeros(7))}),
        "nan": archive(**{**sound(), "g": npy(np.array([np.nan, 1.0]))}),
        "words": archive(**{**sound(), "g": npy(np.array(["a", "b"]))}),
        "complex": archive(**{**sound(), "g": npy(np.array([1j, 2.0]))}),
        "names that are no names": archive(**{**sound(), "rows": npy(np.array("{}"))}),
        "names of another kind": archive(**{**sound(), "rows": npy(np.array("[[1, 2, 3], [4, 5, 6], [7, 8, 9]]"))}),
        "names nested deep": archive(**{**sound(), "rows": npy(np.array("[" * 100_000))}),
    }  # fmt: skip
    for name, data in bad.items():
        yield Case(f"QP, {name}", lambda solver, data=data: QP.load(written("qp.npz", data)), ())
    yield Case("QP, a folder", lambda solver: QP.load(tempfile.mkdtemp()), ())
    yield Case("QP, a device", lambda solver: QP.load("/dev/zero"), ("file",))
    yield Case("QP, not there", lambda solver: QP.load("/nowhere.npz"), ("/nowhere.npz",))
    yield Case("QP, to nowhere", lambda solver: QP(np.eye(1), [0.0]).save("/nowhere/qp.npz"), ("/nowhere/qp.npz",))

    column, packed = npy(np.zeros(3)), npy(np.zeros((8, 3), np.uint8))
    runs: dict[str, tuple[bytes, bytes]] = {
        "text": (b"hello", b"{}"), "a pickle": (archive(t=npy(np.array([Evil()], object))), b"{}"),
        "petabytes": (archive(t=promising("(1000000000, 1000000)")), b"{}"),
        "gigabytes of zeros": (archive(t=promising("(900000000,)") + bytes(200_000_000)), b"{}"),
        "other lengths": (archive(t=column, q=npy(np.zeros(4))), b"{}"),
        "meta of text": (archive(t=column), b"hello"), "meta of a list": (archive(t=column), b"[]"),
        "meta nested deep": (archive(t=column), b"[" * 200_000), "meta of bytes": (archive(t=column), b"\xff\xfe"),
        **{
            f"stored as {said[:20]}": (archive(t=column, q=packed, **{".stored": npy(np.array(said))}), b"{}")
            for said in ("hello", "[]", '{"t": 1}', '{"q": 99}', '{"q": Infinity}', '{"q": "t"}', '{"q": {}}',
                         '{"gone": null}', '{"q": "q"}', "[" * 9999)
        },
        "a member that climbs": (archive(**{"../../evil": column, "t": npy(np.zeros(4))}), b"{}"),
    }  # fmt: skip
    for name, (arrays, meta) in runs.items():
        blamed = ("run.npz" if meta == b"{}" else "meta.json",)  # what is not sound
        says = () if "other" in name or "climbs" in name else blamed
        yield Case(f"run, {name}", lambda solver, a=arrays, m=meta: Run.load(run_folder(a, m)), says)
    yield Case("run, not there", lambda solver: Run.load("/nowhere"), ("/nowhere",))
    sound_run = json.dumps({"scenario": "x"}).encode()
    yield Case("run, a sound one", lambda solver: Run.load(run_folder(archive(t=column), sound_run)).rows)

    for text, said in (
        ("../../etc/passwd:x", "etc/passwd"), ("nowhere.py:x", "nowhere.py"), ("os:system", "os:system"),
        ("no_such_module_at_all:x", "no_such_module_at_all"), (":", ""),
    ):  # fmt: skip
        yield Case(f"scenario {text}", lambda solver, text=text: find(text), (said,))
    for text in ("amplitude", "=3", "sway=nan", "sway=__import__('os')", "no_such=1"):
        said = text.partition("=")[0] if text in ("amplitude", "no_such=1") else ""
        yield Case(f"parameter {text}", lambda solver, text=text: find("humanoid-stand").parse([text]), (said,))
