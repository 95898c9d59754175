"""``wbc export`` as a user types it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.report.conftest import reaching_run
from wbc.errors import NotSupported


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    reaching_run().save(tmp_path / "run")
    return tmp_path / "run"


def test_a_log_is_written_and_its_size_said(wbc, recorded: Path, tmp_path: Path):
    pytest.importorskip("mcap")
    answer = wbc("export", recorded, "--mcap", "run.mcap")
    assert answer.code == 0 and answer.out.startswith("run.mcap: ") and answer.out.endswith(" MB\n")
    assert (tmp_path / "run.mcap").read_bytes().startswith(b"\x89MCAP")


def test_all_files_are_written_or_none(wbc, recorded: Path, tmp_path: Path, monkeypatch):
    """A place that cannot be written is named before any work; work that fails leaves nothing."""
    pytest.importorskip("mcap")

    def fails(*_, **__):
        raise NotSupported("no recording today")

    monkeypatch.setattr("wbc.export.to_rerun", fails)
    answer = wbc("export", recorded, "--mcap", "run.mcap", "--rerun", "run.rrd")
    assert answer.code == 2 and "no recording today" in answer.err
    answer = wbc("export", recorded, "--mcap", "run.mcap", "--rerun", "nowhere/run.rrd")
    assert answer.code == 2 and "nowhere/run.rrd cannot be written" in answer.err and "exporting" not in answer.err
    assert {path.name for path in tmp_path.iterdir()} == {"run"}
