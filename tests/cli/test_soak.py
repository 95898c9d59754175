"""``wbc soak``: rows of figures, an exit code that is a verdict."""

from __future__ import annotations

import json


def test_a_soak_prints_its_figures_and_writes_them(wbc, tmp_path):
    answer = wbc("soak", "arm-velocity", "--ticks", 600, "--json", "rows.json")
    assert answer.code == 0
    assert "arm-velocity" in answer.out and "100.000 %" in answer.out
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert row["ok"] and row["ticks"] == 600 and row["fallback_levels"] == {"solved": 600} and not row["exceptions"]


def test_the_same_seed_gives_the_same_bits(wbc, tmp_path):
    digests = []
    for seed in (1, 1, 2):
        wbc("soak", "arm-acceleration", "--ticks", 100, "--seed", seed, "--json", "rows.json")
        digests.append(json.loads((tmp_path / "rows.json").read_text())[0]["digest"])
    assert digests[0] == digests[1] != digests[2]


def test_where_nothing_is_registered_there_is_no_verdict(wbc, monkeypatch):
    monkeypatch.setattr("wbc.plugins.entry_points", lambda group: ())
    answer = wbc("soak")
    assert answer.code == 2 and answer.out == "" and "no soak is registered" in answer.err
