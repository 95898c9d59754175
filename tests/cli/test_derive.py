"""``wbc derive``: a derivation on the terminal or as LaTeX; what is no chain is one sentence."""

from __future__ import annotations

import pytest
from sympy.printing.pretty.pretty_symbology import pretty_use_unicode


@pytest.mark.parametrize("name", ["pr", "PR", "PxR"])
def test_the_pr_robot_is_derived_step_by_step(wbc, name):
    answer = wbc("derive", name)
    assert answer.code == 0 and not answer.err
    places = [answer.out.index(title) for title in ("1. The chain", "4. Inertia matrix", "11. Momentum")]
    assert places == sorted(places)
    assert "⎡ m₁ + m₂    −m₂ d₂ s₂ ⎤" in answer.out
    assert "β₂ = m₂ d₂ c₂ q̇₁ q̇₂ + m₂ d₂ g₀ c₂" in answer.out


def test_the_four_prismatic_joints_have_a_name(wbc):
    answer = wbc("derive", "4p")
    assert answer.out == wbc("derive", "PxPyPxPy").out
    assert "⎡m₃ + m₄  0 ⎤" in answer.out and "a₁ = m₁ + m₂ + m₃ + m₄" in answer.out
    assert "M is constant, so there are none" in answer.out


def test_any_chain_is_derived_within_the_width_of_the_terminal(wbc, monkeypatch):
    monkeypatch.setenv("COLUMNS", "90")
    answer = wbc("derive", "RPy")
    assert answer.code == 0 and "RPy" in answer.out
    wide = [line for line in answer.out.splitlines() if len(line) > 110]
    assert wide == []


def test_latex_is_a_document(wbc):
    answer = wbc("derive", "pr", "--latex")
    assert answer.code == 0
    assert answer.out.startswith(r"\documentclass{article}") and answer.out.endswith("\\end{document}\n")
    assert r"\tau_{1} = " in answer.out


def test_a_missing_chain_is_one_sentence_too(wbc):
    answer = wbc("derive")
    assert answer.code == 2 and answer.err.count("\n") == 1


def test_help_says_how_chains_are_spelled(wbc):
    answer = wbc("derive", "--help")
    assert answer.code == 0 and "prismatic" in answer.out


@pytest.mark.parametrize("unicode", [False, True])
def test_signs_are_the_same_whatever_sympy_takes_stdout_for(wbc, unicode):
    before = pretty_use_unicode(unicode)
    try:
        assert "a₁ = m₁ + m₂ + m₃ + m₄" in wbc("derive", "4p").out
        assert bool(pretty_use_unicode()) is unicode
    finally:
        pretty_use_unicode(before)
