"""A thousand runs are a thousand results, whatever happens to those who do them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("distributed", reason="the extra sweep is not installed")

import psutil

from wbc.errors import InvalidInput
from wbc.sweep import Range, Sweep, cluster, repeat, resume, sweep
from wbc.sweep.run import in_order, read

FLIP = f"{Path(__file__).with_name('flipping.py')}:flip"
RUNS, FEWER = 1000, 150
TIMES = ("tick_us",)


def results(folder: Path) -> list[dict[str, Any]]:
    return [{k: v for k, v in line.items() if k not in TIMES} for line in in_order(read(folder / "results.jsonl"))]


def plan(runs: int = RUNS, **fixed: Any) -> Sweep:
    return Sweep(FLIP, runs=runs, vary={"bias": Range(0, 1)}, fixed=fixed, seed=5)


def check_complete(folder: Path, runs: int = RUNS) -> None:
    found = results(folder)
    assert [r["run"] for r in found] == list(range(runs))
    assert all(r["error"] is None for r in found)
    for r in found[:: runs // 10]:
        trial = plan().trial(r["run"])
        assert r["parameters"]["bias"] == float(f"{trial.parameters['bias']:.9g}")
        assert r["ok"] == repeat(folder, r["run"], scenario=FLIP)["ok"]
    assert (folder / "report.html").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.parametrize("runs", [FEWER, pytest.param(RUNS, marks=pytest.mark.deep)])
def test_a_worker_of_our_own_that_is_killed_midway_loses_nothing(tmp_path: Path, runs: int):
    deadly = tmp_path / "deadly"

    def progress(done: float, text: str = "") -> None:
        if 0.4 < done < 0.41:
            deadly.touch()

    report = sweep(plan(runs, deadly=str(deadly)), out=tmp_path / "out", workers=2, progress=progress)
    assert not deadly.exists(), "a worker found it and died of it"
    check_complete(tmp_path / "out", runs)
    assert f" of {runs} runs " in report.summary


def test_a_result_that_is_lost_with_its_worker_is_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A worker may die between the end of a run and the fetching of its result."""
    from distributed import Future
    from distributed.scheduler import KilledWorker

    lost: list[str] = []
    fetch = Future.result

    def result(future: Future, *args: Any, **more: Any) -> Any:
        if len(lost) < 3:
            lost.append(future.key)
            raise KilledWorker(future.key, None, 3)
        return fetch(future, *args, **more)

    monkeypatch.setattr(Future, "result", result)
    sweep(plan(FEWER), out=tmp_path / "out", workers=2)
    check_complete(tmp_path / "out", FEWER)
    assert len(lost) == 3


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers as somebody else would have started them."""
    place = tmp_path / "scheduler.json"
    quiet = {"cwd": tmp_path, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    python = [sys.executable, "-m"]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    started = [
        subprocess.Popen(
            [*python, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
             "--scheduler-file", str(place)], env=env, **quiet,
        )
    ]  # fmt: skip
    try:
        _until(lambda: place.exists() and place.read_text().endswith("\n}"))  # it is written in parts
        address = json.loads(place.read_text())["address"]
        started += [
            subprocess.Popen(
                [*python, "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"],
                env=env, **quiet,
            ) for _ in range(2)
        ]  # fmt: skip
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


def _until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it never came true"
        time.sleep(0.05)


def test_somebody_elses_workers_may_die_too(tmp_path: Path, scheduler: tuple[str, list[subprocess.Popen[bytes]]]):
    address, workers = scheduler

    def progress(done: float, text: str = "") -> None:
        if done > 0.4 and workers[0].poll() is None:
            workers[0].send_signal(signal.SIGKILL)
            workers[0].wait()

    sweep(plan(FEWER), out=tmp_path / "out", scheduler=address, progress=progress)
    assert workers[0].returncode == -signal.SIGKILL and workers[1].poll() is None
    check_complete(tmp_path / "out", FEWER)


def test_an_interrupted_sweep_goes_on_and_ends_with_the_same_results(tmp_path: Path):
    def few() -> Sweep:
        return Sweep(FLIP, runs=30, vary={"bias": Range(0, 1)})

    class Enough(Exception):
        pass

    def progress(done: float, text: str = "") -> None:
        if done > 0.3:
            raise Enough

    with pytest.raises(Enough):
        sweep(few(), out=tmp_path / "broken", workers=1, progress=progress)
    before = results(tmp_path / "broken.unfinished")
    assert 8 < len(before) < 30 and not (tmp_path / "broken").exists()
    with pytest.raises(InvalidInput, match="--resume"):
        sweep(few(), out=tmp_path / "broken")
    resume(tmp_path / "broken", scenario=FLIP, workers=1)
    assert not (tmp_path / "broken.unfinished").exists()
    after = results(tmp_path / "broken")
    assert [r["run"] for r in after] == list(range(30)) and all(r in after for r in before)
    assert after == [
        {k: v for k, v in repeat(tmp_path / "broken", i, scenario=FLIP).items() if k not in TIMES} for i in range(30)
    ]


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_all_processes_of_a_sweep_ends_them_without_a_traceback(end: signal.Signals, tmp_path: Path):
    """As Ctrl-C in a terminal, which the workers get, too."""
    command = ["wbc", "sweep", FLIP, "--set", "wait=0.2", "--runs", "30", "--workers", "2", "--out", "out"]
    started = subprocess.Popen(
        [sys.executable, "-m", *command], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    lines = tmp_path / "out.unfinished" / "results.jsonl"
    _until(lambda: lines.is_file() and lines.read_text().count("\n") > 3)
    everybody = psutil.Process(started.pid).children(recursive=True)
    os.killpg(started.pid, end)
    _, said = started.communicate(timeout=60.0)
    assert started.returncode == 130 and "continue with: wbc sweep" in said and "Traceback" not in said
    _until(lambda: not [one for one in everybody if one.is_running() and one.status() != psutil.STATUS_ZOMBIE], 10.0)
    assert [path.name for path in tmp_path.iterdir()] == ["out.unfinished"]
    resume(tmp_path / "out", scenario=FLIP, workers=2)
    assert [result["run"] for result in results(tmp_path / "out")] == list(range(30))


def test_there_must_be_somebody_and_something(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cluster, "CONNECT", "1s")
    with pytest.raises(InvalidInput, match="no unfinished sweep"):
        resume(tmp_path / "nothing")
    with pytest.raises(InvalidInput, match="not the folder of a sweep"):
        repeat(tmp_path, 0)
    with pytest.raises(InvalidInput, match="no scheduler answers"):
        sweep(plan(), out=tmp_path / "out", scheduler="tcp://127.0.0.1:1")
