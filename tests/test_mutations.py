"""The tool that draws slips: what it changes, what it leaves alone, and that it tells noticed from unnoticed ones."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.calls import map_of
from tests.mutations import ROOT, SOURCES, drawn, verdicts
from tests.slips import slips

TOY = '''"""A module of its own; 1 < 2."""

from __future__ import annotations

import warnings

SCALE: Literal[4] = 2.0  # of every answer


class Spring:
    """A spring of stiffness 3, min(1, 2)."""

    def __init__(self, stiffness: float = 3.0) -> None:
        if stiffness < 0.0:
            raise ValueError(f"{stiffness - 1} is < 0, not {1 + 1}")
        self.stiffness = stiffness

    def __repr__(self) -> str:
        return "Spring" + str(self.stiffness + 1)

    def force(self, x: float) -> float:
        """The force at x = 1."""
        return SCALE * self.stiffness * x

    def untested(self, x: float) -> float:
        warnings.warn("a" + str(1 + x))
        return x - 1.0
'''
TESTS = """
import pytest
from wbc.toy import Spring

def test_the_force():
    assert Spring().force(2.0) == 12.0

def test_the_refusal():
    assert Spring(0.0).stiffness == 0.0
    with pytest.raises(ValueError):
        Spring(-1.0)
"""
MORE_TESTS = """
from wbc.toy import Spring

def test_the_sign():
    assert Spring().force(1.0) > 0.0
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project of one module and one file of tests."""
    (tmp_path / "wbc").mkdir()
    (tmp_path / "tests").mkdir()
    (tmp_path / "wbc" / "__init__.py").write_text("")
    (tmp_path / "wbc" / "toy.py").write_text(TOY)
    (tmp_path / "tests" / "test_toy.py").write_text(TESTS)
    (tmp_path / "tests" / "test_more.py").write_text(MORE_TESTS)
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\npythonpath = ['.']\n")
    return tmp_path


def test_docstrings_annotations_messages_and_repr_are_left_alone():
    changed = [str(slip).removeprefix("toy.py:") for slip in slips("toy.py", TOY)]
    assert sorted({text.split(" ", 1)[1] for text in changed}) == [
        ": 2.0 -> 0.002", ": 2.0 -> 2000.0",
        "Spring.__init__: 0.0 -> 1.0", "Spring.__init__: 3.0 -> 0.003", "Spring.__init__: 3.0 -> 3000.0",
        "Spring.__init__: raise ValueError(f\"{stiffness - 1} is < 0, not {1 + 1}\") -> pass",
        "Spring.__init__: self.stiffness = stiffness -> pass", "Spring.__init__: stiffness < 0.0 -> (stiffness >= 0.0)",
        "Spring.force: SCALE * self.stiffness * x -> (SCALE * self.stiffness / x)",
        "Spring.force: SCALE * self.stiffness -> (SCALE / self.stiffness)",
        "Spring.untested: 1.0 -> 0.001", "Spring.untested: 1.0 -> 1000.0",
        'Spring.untested: warnings.warn("a" + str(1 + x)) -> pass', "Spring.untested: x - 1.0 -> (x + 1.0)",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("source", "changed"),
    [
        ("x = min(a, b)", ["x = max(a, b)"]),
        ("x = np.maximum(a, b)", ["x = np.minimum(a, b)"]),
        ("f(a, b)", ["f(b, a)", "pass"]),
        ("a and not b", ["(a or not b)", "a and (b)"]),
        ("i < n", ["(i <= n)", "(i >= n)"]),
        ("flag = True", ["flag = False"]),
        ("-x", ["(x)"]),
        ("x += 2", ["pass", "x -= 2", "x += 3", "x += 1"]),
        ("x[3] = y", ["pass", "x[4] = y", "x[2] = y"]),
        ("é = 'ü' + str(1)", ["é = 'ü' + str(2)", "é = 'ü' + str(0)"]),
    ],
)
def test_slips_of_each_kind(source: str, changed: list[str]):
    assert {slip.applied(source.encode()).decode() for slip in slips("file.py", source)} == set(changed)


@pytest.mark.slow
def test_every_slip_in_the_sources_can_be_parsed_and_the_draw_depends_on_the_seed_alone():
    first = drawn(ROOT, 300, 1)
    sources = {slip.file: (ROOT / slip.file).read_bytes() for slip in first}
    trees = {file: ast.dump(ast.parse(source)) for file, source in sources.items()}
    for slip in first:
        assert ast.dump(ast.parse(slip.applied(sources[slip.file]))) != trees[slip.file], slip
        assert slip.file.startswith(SOURCES)
    again, other = (drawn(ROOT, 100, seed, ("wbc/methods",)) for seed in (1, 2))
    assert drawn(ROOT, 100, 1, ("wbc/methods",)) == again
    assert len(set(other) & set(again)) < 30


def test_slips_that_a_test_notices_are_told_from_those_that_none_does(project: Path):
    calls = map_of(project, project / "cache", jobs=1)
    chosen = [slip for slip in slips("wbc/toy.py", TOY) if "3" not in slip.old]
    survivors = [slip for slip, said in verdicts(project, chosen, calls, jobs=2, patience=60.0) if "NOT" in said]
    assert {slip.function for slip in survivors} == {"Spring.untested"}
    assert len(survivors) == 4 and len(chosen) > 8
    assert (project / "wbc" / "toy.py").read_text() == TOY


def test_a_test_file_that_does_not_end_is_left_out(tmp_path: Path):
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_hangs.py").write_text("import time\n\ndef test_it():\n    time.sleep(600.0)\n")
    assert map_of(tmp_path, tmp_path / "calls", jobs=1, hung=2.0).files == {}
