"""What makes no sense on the command line is one sentence on stderr and exit code 2, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.qp.zoo import random_qp
from tests.report.conftest import reaching_run

HERE = Path(__file__).parent
FLIP, WAVE = f"{HERE.parent / 'sweep' / 'flipping.py'}:flip", f"{HERE / 'waving.py'}"
#: Words after ``wbc``, and words of the sentence. ``problems`` is a folder of QPs, ``run`` one of a run.
SENTENCES = [
    ("rum", "No such command 'rum'"),
    ("run humanoid-stnad", "there is no scenario 'humanoid-stnad'"),
    ("run nowhere.py:wave", "there is no file 'nowhere.py'"),
    ("run nowhere_at_all:wave", "'nowhere_at_all' cannot be imported: ModuleNotFoundError"),
    (f"run {WAVE}:wavy", "there is no scenario 'wavy'; did you mean 'wave'"),
    (f"run {WAVE}:not_a_scenario", "not_a_scenario is a int, not a"),
    *((f"run {WAVE}:wave {words}", says) for words, says in (
        ("--solver pdass", "there is no solver 'pdass'; did you mean 'pdas'"),
        ("--plant moon", "paper (the plants of the scenario 'wave')"),
        ("--hierarchy strictly", "of the scenario 'wave')"),
        ("--set robot=humanoyd", "no robot 'humanoyd'; did you mean 'humanoid'"),
        ("--set amplitud=1", "no parameter 'amplitud'; did you mean"),
        ("--set amplitude", "--set 'amplitude' must be key=value"),
        ("--set amplitude=big", "parameter 'amplitude' must be a number"),
        ("--set waves=1.5", "parameter 'waves' is '1.5'; it must be a whole"),
        ("--set good=perhaps", "it must be one of true, yes, on, 1, false, no, off, 0"),
        ("--set axis=1,2", "parameter 'axis' must have shape (3,), not (2,)"),
        ("--duration 0", "duration is 0; it must be > 0"),
        ("--duration long", "Invalid value for '--duration'"),
        ("--sovler pdas", "No such option: --sovler"),
    )),
    *((f"derive {word}", says) for word, says in (
        ("XR", "at 'XR'"), ("PxQ", "at 'Q'"), ("RRRRRRR", "7 joints; it must have 1 to 6"), ("5p", "at '5p'"))),
    ("deploy quadrupde --check", "did you mean 'quadruped'?"),
    ("deploy arm", "wbc deploy arm --check"),
    ("explain nowhere.npz", "nowhere.npz"),
    ("explain run/meta.json", "meta.json"),
    ("explain run/meta.json --solver dapq", "did you mean 'daqp'"),
    ("export run", "--gif"),
    ("export run --gif run.webp", "must end in .gif"),
    ("export run --gif run.gif --camera 1", "azimuth"),
    *((f"export run --gif run.gif --size={size}", f"--size {size}: give width and height")
      for size in ("640", "640x", "x480", "640x480x3", "640*480", "-1x5", "6e2x4e2", "640.5x480")),
    ("export run --gif run.gif --robot humanoid", "other joints"),
    ("export run --mcap nowhere/run.mcap", "cannot be written"),
    ("soak arm-speed", "there is no scenario 'arm-speed'"),
    ("soak tasks:Posture", "not a wbc.sim.scenario.Scenario"),
    ("soak arm-velocity --kind salt", "valid, fuzz, starts"),
    ("soak arm-velocity --solver dapq", "did you mean 'daqp'"),
    ("soak arm-velocity --seed -1", "seed is -1; it must be a whole number"),
    ("report solvers", "give a scenario"),
    ("report solvers nowhere", "nowhere"),
    ("report solvers --resume", "--out"),
    ("report solvers --resume --out r", "no unfinished comparison"),
    ("report solvers problems --solver no", "no"),
    ("report solvers problems --set push=1", "parameter of a scenario"),
    ("report solvers arm-reach --set pish=1", "pish"),
    ("report solvers --from problems", "data.json"),
    ("compare problems nowhere", "is not the folder of a run"),
    ("compare problems", "is not the folder of a run"),
    ("sweep", "give a scenario"),
    (f"sweep {FLIP} --vary bias", "LOW:HIGH"),
    (f"sweep {FLIP} --vary pias=0:1", "pias"),
    (f"sweep {FLIP} --push torso", "FRAME=LOW:HIGH"),
    (f"sweep {FLIP} --solver no", "no"),
    ("sweep --resume", "--out"),
    ("sweep --repeat 3 --out nowhere", "nowhere"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "says"), SENTENCES, ids=[says for _, says in SENTENCES])
def test_what_makes_no_sense_is_one_sentence(wbc, tmp_path: Path, words: str, says: str):
    (tmp_path / "problems").mkdir()
    random_qp(0, 6, 1, 4).save(tmp_path / "problems" / "0.npz")
    reaching_run().save(tmp_path / "run")
    before = sorted(tmp_path.rglob("*"))
    answer = wbc(*words.split())
    assert answer.code == 2 and answer.out == ""
    said = [line for line in answer.err.splitlines() if line != "a scenario that chatters"]
    assert len(said) == 1 and said[0].startswith("wbc: ") and says in said[0]
    assert sorted(tmp_path.rglob("*")) == before
