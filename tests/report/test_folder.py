"""A report is on disk whole, or not at all."""

from __future__ import annotations

from errno import ENOSPC
from pathlib import Path

import pytest

from wbc.errors import InvalidInput
from wbc.report.document import Report
from wbc.report.folder import HTML, MARKDOWN, RECORDS, replaced, write


def test_a_folder_appears_when_the_block_ends(tmp_path: Path):
    target = tmp_path / "deep" / "report"
    with replaced(target) as pending:
        (pending / HTML).write_text("new")
        assert not target.exists() and pending.parent == target.parent
    assert [path.name for path in target.parent.iterdir()] == ["report"]
    assert (target / HTML).read_text() == "new"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_nothing_is_left_when_the_block_fails(tmp_path: Path, error: type[BaseException]):
    with pytest.raises(error), replaced(tmp_path / "report") as pending:
        (pending / HTML).write_text("half")
        raise error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("page", [HTML, MARKDOWN])
def test_a_full_disk_is_told_with_the_place(tmp_path: Path, page: str, monkeypatch: pytest.MonkeyPatch):
    writing = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.suffix == Path(page).suffix:
            raise OSError(ENOSPC, "No space left on device")
        return writing(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InvalidInput, match=f"{tmp_path / page} cannot be written: No space left"):
        write(Report("t", "s", None, []), tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_older_report_is_replaced_whole(tmp_path: Path):
    for word in ("old", "new"):
        with replaced(tmp_path / "report") as pending:
            (pending / HTML).write_text(word)
            (pending / word).touch()
    assert sorted(path.name for path in (tmp_path / "report").iterdir()) == ["new", HTML]
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_an_older_report_stays_when_the_new_one_fails(tmp_path: Path):
    with replaced(tmp_path / "report") as pending:
        (pending / HTML).write_text("old")
    with pytest.raises(ValueError, match="no"), replaced(tmp_path / "report"):
        raise ValueError("no")
    assert (tmp_path / "report" / HTML).read_text() == "old"


def test_anything_else_is_never_written_over(tmp_path: Path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").touch()
    (tmp_path / "file").touch()
    with pytest.raises(InvalidInput, match="holds something else"), replaced(tmp_path / "thesis"):
        pass
    with pytest.raises(InvalidInput, match="is a file"), replaced(tmp_path / "file"):
        pass
    assert (tmp_path / "thesis" / "chapter.tex").exists()


@pytest.mark.parametrize("record", RECORDS)
def test_a_record_is_replaced_by_one_of_its_kind_alone(tmp_path: Path, record: str):
    target = tmp_path / "report"
    with replaced(target, record) as pending:
        (pending / HTML).write_text("old")
        (pending / record).write_text("hours of work")
    for other in (None, *(one for one in RECORDS if one != record)):
        with pytest.raises(InvalidInput, match=f"holds {record}, which would be lost"), replaced(target, other):
            pass
    assert (target / record).read_text() == "hours of work"
    with replaced(target, record) as pending:
        (pending / HTML).write_text("new")
        (pending / record).write_text("new")
    assert (target / record).read_text() == "new"


def test_a_place_that_cannot_be_written_is_said_so(tmp_path: Path):
    (tmp_path / "file").touch()
    with pytest.raises(InvalidInput, match="cannot be written"), replaced(tmp_path / "file" / "report"):
        pass
