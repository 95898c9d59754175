"""Files that the library wrote and reads back: spoilt in any way they are refused by name, and never executed."""

from __future__ import annotations

import ast
import base64
import json
import os
import pickle
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.seeds import generator
from wbc.errors import InvalidInput, WbcError
from wbc.qp import QP
from wbc.qp.solvers import by_name
from wbc.report.journal import Journal
from wbc.report.solvers import compare, redraw
from wbc.report.solvers import data as comparison_data
from wbc.report.solvers import resume as resume_comparison
from wbc.report.solvers.problems import ProblemSet, sequence
from wbc.report.solvers.request import Request, ScenarioRequest
from wbc.sim.provenance import surroundings
from wbc.sweep import Choice, Range, Sweep, repeat
from wbc.sweep import resume as resume_sweep
from wbc.sweep.draw import CODEC, RandomDelay, RandomNoise, RandomPayload, RandomPush
from wbc.sweep.run import plan_of, read

ROOT = Path(__file__).parents[2]
FLIP = f"{ROOT / 'tests' / 'sweep' / 'flipping.py'}:flip"
#: Makes kernels of the shapes that stand in the sources; nothing of it was read from a file.
MAKES_CODE = "wbc/compiled.py"
EXECUTING = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "joblib", "yaml", "jsonpickle"}
NONSENSE = (None, True, 3, -1, 1e308, "x", "", [], {}, [[]], {"kind": "Evil"}, {"kind": 3}, "a:b", "\x00", [None] * 3)


def test_no_source_can_unpickle_or_evaluate_a_file():
    found = []
    for path in [*(ROOT / "wbc").rglob("*.py"), *(ROOT / "tasks").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {alias.name.split(".")[0] for alias in node.names} if isinstance(node, ast.Import) else set()
            if isinstance(node, ast.ImportFrom) and node.module:
                names = {node.module.split(".")[0]}
            called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            allows = [k for k in getattr(node, "keywords", ()) if k.arg == "allow_pickle" and _is_true(k.value)]
            if names & EXECUTING or called in ("eval", "exec", "__import__") or allows:
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    found = [place for place in found if not place.startswith(MAKES_CODE)]
    assert not found


def _is_true(node: ast.expr) -> bool:
    return not (isinstance(node, ast.Constant) and node.value is False)


# ---- what a sweep keeps
def sweep_plan() -> Sweep:
    return Sweep(
        FLIP, runs=3, vary={"bias": Range(0, 1), "coin": Choice(("a", "b")), "faces": Range(2, 6, whole=True)},
        fixed={"wait": 0.0}, disturbances=(
            RandomPush("torso", Range(1, 2)), RandomPayload("hand", Range(0.1, 1)), RandomNoise(Range(0, 0.1)),
            RandomDelay(Range(0.001, 0.002)),
        ), solvers=("pdas", "daqp"), hierarchies=("weighted",), duration=0.1, seed=7,
    )  # fmt: skip


def sweep_header(plan: Any) -> dict[str, Any]:
    about = {"scenario": "flip", "sweep": "x", "runs": 3, "seed": 7, "date": "today", "machine": {}, "versions": {}}
    return {**about, "plan": plan}


def test_the_settings_of_a_sweep_survive_the_file(tmp_path: Path):
    plan = sweep_plan()
    Journal.begin(tmp_path / "results.jsonl", "run", sweep_header(plan.to_json()))
    again = plan_of(read(tmp_path / "results.jsonl"), FLIP)
    assert again == plan and again.trial(2) == plan.trial(2)


@pytest.mark.parametrize(
    "value", [Range(0, 1), Choice((1, "a", (0.0, 1.0))), ("a", 1.5), None, {"a": Range(1, 2)}, np.inf]
)
def test_plain_values_come_back_as_they_were(value: Any):
    assert CODEC.whole(json.loads(json.dumps(CODEC.plain(value), allow_nan=False))) == value


@pytest.mark.parametrize("value", [object(), 1j, {1: 2}, {"is": 1}, np.array([None])])
def test_values_without_a_form_in_json_are_refused(value: Any):
    with pytest.raises(InvalidInput):
        CODEC.plain(value)


def test_code_that_a_file_names_is_not_run_without_the_user_naming_it(tmp_path: Path):
    evil, proof = tmp_path / "evil.py", tmp_path / "it ran"
    evil.write_text(f"from pathlib import Path\nPath({str(proof)!r}).touch()\n")
    plan = {**sweep_plan().to_json(), "scenario": f"{evil}:x"}
    (tmp_path / "s").mkdir()
    Journal.begin(tmp_path / "s" / "results.jsonl", "run", sweep_header(plan))
    write_journal(tmp_path / "c.unfinished", scenarios=[ScenarioRequest(f"{evil}:x", "x", {}, {})])
    for attempt in (lambda: repeat(tmp_path / "s", 0), lambda: resume_comparison(tmp_path / "c")):
        with pytest.raises(InvalidInput, match="is the Python code"):
            attempt()
    assert not proof.exists()
    with pytest.raises(WbcError):  # named by the user it runs, and has no scenario called x
        repeat(tmp_path / "s", 0, scenario=f"{evil}:x")
    assert proof.exists()


# ---- what a comparison keeps
def write_journal(folder: Path, **settings: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    request = Request([by_name("pdas"), by_name("proxqp")], loop=False, **settings)
    header = {"surroundings": surroundings(), "request": request.to_json(), "unread": {}}
    Journal.begin(folder / "journal.jsonl", "key", header)
    return folder / "journal.jsonl"


# ---- every file, spoilt in every place
class Evil:
    """Says so when somebody unpickles it."""

    def __init__(self, proof: Path) -> None:
        self.proof = proof

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (os.mkdir, (str(self.proof),))


def readers(folder: Path) -> Iterator[tuple[str, Path, Callable[[], object]]]:
    """Kind, file, and what reads it."""
    Journal.begin(folder / "done" / "results.jsonl", "run", sweep_header(sweep_plan().to_json()))
    yield "a sweep", folder / "done" / "results.jsonl", lambda: plan_of(read(folder / "done" / "results.jsonl"), FLIP)
    Journal.begin(folder / "s.unfinished" / "results.jsonl", "run", sweep_header(sweep_plan().to_json()))
    yield "a sweep to resume", folder / "s.unfinished" / "results.jsonl", lambda: resume_sweep(folder / "s")
    journal = write_journal(folder / "c.unfinished")
    yield "a journal", journal, lambda: resume_comparison(folder / "c")
    data = folder / "data.json"
    measured = compare([QP([[2.0]], [-2.0 * k], ub=[1.0]) for k in range(3)], solvers=["pdas"], rounds=1)
    comparison_data.write(measured, data)
    yield "raw data", data, lambda: redraw(data, folder / "page")


def places(value: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to each value of a JSON document."""
    yield way
    for key, item in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(item, (*way, key))


def put(document: Any, way: tuple[Any, ...], value: Any) -> Any:
    """The document with another value there."""
    if not way:
        return value
    copy = dict(document) if isinstance(document, dict) else list(document)
    copy[way[0]] = put(document[way[0]], way[1:], value)
    return copy


@pytest.mark.parametrize("which", range(4), ids=["sweep", "sweep to resume", "journal", "raw data"])
def test_a_spoilt_file_is_refused_and_never_executed(tmp_path: Path, which: int, monkeypatch: pytest.MonkeyPatch):
    for name in ("done", "s.unfinished"):
        (tmp_path / name).mkdir()
    # Whatever is accepted is about to be run; these tests end there.
    monkeypatch.setattr("wbc.sweep.run._finished", lambda *args, **settings: None)
    _, file, read = next(islice(readers(tmp_path), which, None))
    monkeypatch.setattr("wbc.report.solvers.comparison._finished", lambda *args, **settings: None)
    rng = generator("spoilt files", which)
    sound, proof = file.read_text(), tmp_path / "it ran"
    first, *others = sound.splitlines() if file.suffix == ".jsonl" else [sound]
    document = json.loads(first)
    evil = base64.b64encode(pickle.dumps(Evil(proof))).decode()
    spoilt = [put(document, way, value) for way in places(document) for value in (*NONSENSE, evil)]
    keep = rng.choice(len(spoilt), min(len(spoilt), (400, 400, 100, 6)[which]), replace=False)
    texts = ["\n".join([json.dumps(spoilt[i]), *others]) + "\n" for i in sorted(keep)]
    texts += [sound[: rng.integers(len(sound))] for _ in range(4)]
    texts += ["", "\n", "[" * 100_000, "\x80", evil, "{}\n{}", 'null\n{"run": 1}']
    refused = 0
    for text in texts:
        file.write_text(text)
        try:
            read()
        except WbcError:
            refused += 1
    assert refused > len(texts) / 3 and not proof.exists()


@pytest.mark.parametrize("kind", ["problem set", "QP"])
def test_spoilt_arrays_are_refused_and_never_unpickled(tmp_path: Path, kind: str):
    rng, file, proof = generator("spoilt arrays", kind), tmp_path / "file.npz", tmp_path / "it ran"
    if kind == "problem set":
        sequence("set", [QP([[2.0]], [-2.0 * k], ub=[1.0]) for k in range(3)]).save(file)
    else:
        QP([[2.0]], [1.0], ub=[1.0]).save(file)
    readers: dict[str, Callable[[Path], object]] = {
        "problem set": ProblemSet.load, "QP": QP.load
    }  # fmt: skip
    sound, names = file.read_bytes(), list(np.load(file, allow_pickle=False))
    spoilt = []
    for name in names:  # a pickle in the place of each array
        arrays = {key: np.load(file, allow_pickle=False)[key] for key in names}
        arrays[name] = np.array([Evil(proof)], dtype=object)
        np.savez(tmp_path / "evil.npz", **arrays)
        spoilt.append((tmp_path / "evil.npz").read_bytes())
    for _ in range(200):  # bytes that flipped, and files that end early
        content = bytearray(sound)
        for place in rng.integers(len(sound), size=rng.integers(1, 5)):
            content[place] = rng.integers(256)
        spoilt.append(bytes(content[: rng.integers(1, len(sound))] if rng.uniform() < 0.3 else content))
    refused = 0
    for content in spoilt:
        file.write_bytes(content)
        try:
            readers[kind](file)
        except WbcError:
            refused += 1
    assert refused >= len(names) + 100 and not proof.exists()
