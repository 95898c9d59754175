"""Every help page shows its texts whole, units in brackets too, and ends with exit code 0."""

from __future__ import annotations

import re

import pytest
import typer

from wbc.cli.app import app
from wbc.sim.scenario import scenarios
from wbc.stack.hierarchy import HIERARCHIES


def pages(command, words=()):
    """Each command with the words that reach it."""
    yield words, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from pages(inner, (*words, name))


PAGES = dict(pages(typer.main.get_command(app)))


def squeezed(text: str) -> str:
    """Letters, digits and brackets alone: tables break lines wherever they like."""
    return re.sub(r"[^A-Za-z0-9\[\]=]", "", text)


@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_help_shows_every_text(wbc, words, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    answer = wbc(*words, "--help")
    assert answer.code == 0 and not answer.err
    shown = squeezed(answer.out)
    for parameter in PAGES[words].params:
        text = getattr(parameter, "help", None)
        assert not text or squeezed(text) in shown, parameter.name


@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_words_that_are_not_understood_lead_to_the_help_of_their_command(wbc, words):
    answer = wbc(*words, "--nonsense")
    assert answer.code == 2 and answer.err.count("\n") == 1 and not answer.out
    assert answer.err.endswith(f"(see {' '.join(('wbc', *words))} --help)\n") and "--nonsense" in answer.err


@pytest.mark.parametrize("words", [(), ("report",)])
def test_a_command_that_only_has_verbs_shows_its_help(wbc, words):
    answer = wbc(*words)
    assert answer.code == 0 and "Usage: " in answer.out and not answer.err


def test_help_of_run_lists_hierarchies_and_plants(wbc):
    shown = squeezed(wbc("run", "--help").out)
    plants = {plant for one in scenarios().values() if one.group != "growth" for plant in one.plants}
    assert all(name in shown for name in (*HIERARCHIES, *plants))
