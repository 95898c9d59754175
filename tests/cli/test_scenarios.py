"""How scenarios are found and how their parameters are read."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.errors import InvalidInput, UnknownScenario, WbcError
from wbc.plugins import GROUP, BrokenPlugin, registered
from wbc.sim.scenario import Scenario, find, scenarios, scenarios_of

from .waving import Wave


@pytest.fixture
def wave(waving) -> Scenario:
    """The scenario of the file."""
    return find(waving)


def test_a_class_is_as_good_as_an_object(waving):
    assert find(waving.replace(":wave", ":Wave")).name == "wave"


def test_a_file_named_like_a_library_does_not_replace_it(tmp_path, waving):
    shutil.copy(waving.rpartition(":")[0], tmp_path / "json.py")
    import json

    assert find(f"{tmp_path / 'json.py'}:wave").name == "wave"
    assert sys.modules["json"] is json
    # Nor in a process that inherits the path, as workers do.
    inherited = {**os.environ, "PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)}
    command = [sys.executable, "-c", "import json; print(json.dumps(1))"]
    assert subprocess.run(command, env=inherited, capture_output=True, text=True, check=True).stdout.strip() == "1"


def test_a_module_is_found_from_where_one_stands(tmp_path, waving, monkeypatch):
    shutil.copy(waving.rpartition(":")[0], tmp_path / "my_waves_for_a_test.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert find("my_waves_for_a_test:wave").name == "wave"


def test_a_file_that_fails_says_why(tmp_path):
    (tmp_path / "broken.py").write_text("import nothing_of_this_name")
    with pytest.raises(InvalidInput, match="cannot be imported: ModuleNotFoundError: No module named 'nothing_of"):
        find(f"{tmp_path / 'broken.py'}:wave")


@pytest.mark.parametrize("as_dict", [True, False])
def test_registered_scenarios_are_found_by_name(monkeypatch, wave, as_dict):
    registered = {"wave": wave} if as_dict else [wave]

    class Point:
        value = "some.package:SCENARIOS"
        load = staticmethod(lambda: registered)

    monkeypatch.setattr("wbc.plugins.entry_points", lambda group: [Point] if group == "wbc.scenarios" else [])
    assert scenarios() == {"wave": wave} and find("wave") is wave
    with pytest.raises(UnknownScenario, match="did you mean 'wave'"):
        find("waves")


BROKEN = {
    "missing": "raise ImportError('no such thing')",
    "exiting": "import sys; sys.exit(7)",
    "of no members": "SCENARIOS = 3",
    "of nameless members": "SCENARIOS = [object()]",
    "without them": "",
}


@pytest.mark.parametrize("source", BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_plugin_loses_only_its_own_members(monkeypatch, tmp_path, source):
    (tmp_path / "broken_plugin.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "broken_plugin", raising=False)
    sound = [point for point in entry_points(group=GROUP)]
    broken = EntryPoint("broken", "broken_plugin:SCENARIOS", GROUP)
    monkeypatch.setattr("wbc.plugins.entry_points", lambda group: [broken, *sound])
    with pytest.warns(BrokenPlugin, match="broken_plugin:SCENARIOS cannot be loaded and is left out"):
        found = registered(Scenario)
    assert found and all(isinstance(member, Scenario) for member in found.values())
    assert found == {name: one for point in sound for name, one in point.load().items()}


def test_a_file_without_a_name_says_what_it_has(tmp_path):
    (tmp_path / "own.py").write_text(Path(__file__).with_name("waving.py").read_text())
    with pytest.raises(InvalidInput, match=r"name a scenario in it: .*own\.py:wave$"):
        find(str(tmp_path / "own.py"))
    (tmp_path / "empty.py").write_text("x = 1")
    with pytest.raises(InvalidInput, match="has no scenario"):
        find(str(tmp_path / "empty.py"))


UNFINISHED = """
from wbc.sim.scenario import Scenario

class Shared(Scenario):
    def judge(self, trials, p):
        pass

class Sized(Shared):
    name = "sized"
    def __init__(self, size):
        self.size = size

class Judged(Shared):
    name, parameters = "judged", {"odd": None}

class Built(Scenario):
    name = "built"
    def build(self, p):
        pass
    def judge(self, trials, p):
        return next(trials)

class Vague(Scenario):
    name = "vague"

small = Sized(1)
"""


def test_of_a_file_those_that_can_run_are_listed_without_what_they_share(tmp_path):
    (own := tmp_path / "own.py").write_text(UNFINISHED)
    assert sorted(scenarios_of(str(own))) == [f"{own}:{name}" for name in ("Built", "Judged", "small")]
    assert find(f"{own}:small").summary == ""
    for name in ("Shared", "Sized", "Vague"):
        with pytest.raises(InvalidInput, match=f"{name} is a class, not a wbc.sim.scenario.Scenario with a name, or a"):
            find(f"{own}:{name}")


def test_an_unfinished_scenario_is_told_what_it_lacks(wbc, tmp_path):
    (own := tmp_path / "own.py").write_text(UNFINISHED)
    for name, said in {
        "Judged": "what judge of the scenario 'judged' returns is None; it must be a ScenarioResult",
        "Built": "what build of the scenario 'built' returns is None; it must be a Setup",
    }.items():
        answer = wbc("run", f"{own}:{name}")
        assert answer.code == 2 and answer.err.startswith(f"wbc: {said}") and not answer.out
    answer = wbc("run", f"{own}:Judged", "--set", "odd=1")
    assert answer.code == 2 and answer.err.startswith("wbc: the default of parameter 'odd' is None; it must be a")


def test_defaults_stand_where_nothing_is_set(wave):
    assert wave.parse([]) == dict(wave.parameters)
    assert wave.choose(plant=None, hierarchy=None, duration=None) == {
        "plant": "paper", "hierarchy": "weighted", "duration": 0.4
    }  # fmt: skip


def test_values_are_read_as_their_defaults_are(wave):
    texts = ["robot=a=b", "amplitude=1e-3", "good=off", "waves=-4", "axis=1,0,2.5"]
    read = wave.parse(texts)
    assert (read["robot"], read["amplitude"], read["good"], read["waves"], read["axis"]) == (
        "a=b", 1e-3, False, -4, (1.0, 0.0, 2.5)
    )  # fmt: skip


@given(text=st.text(max_size=30), key=st.sampled_from(["amplitude", "good", "waves", "axis", "robot"]))
def test_any_text_is_read_as_its_type_or_refused(text: str, key: str):
    wave = Wave()
    try:
        assert type(wave.parse([f"{key}={text}"])[key]) is type(wave.parameters[key])
    except WbcError as error:
        assert key in str(error)
