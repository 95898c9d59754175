"""A page over a folder of runs: who ran what, how it ended, in which settings they differ, and the way to each page."""

from __future__ import annotations

import html as markup
import re
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from wbc import checks
from wbc.control.metadata import check_metadata
from wbc.control.recorder import ARRAYS_FILE, META_FILE
from wbc.errors import InvalidInput
from wbc.files import Place, located, written
from wbc.npz import read_json
from wbc.report.build import require_extras
from wbc.report.document import Address, Cell, Figure, Marked, Report, Section, Table, Tile, neutral, plural
from wbc.report.folder import HTML
from wbc.report.html import html
from wbc.report.markdown import FIGURES
from wbc.report.record import BESIDE, JUDGED, MOTION, RESULTS
from wbc.report.sections import settings

INDEX = "index.html"
#: Folders are looked through so deep.
DEEP = 4
#: A thumbnail is so high, in pixels; of the moments in a report's picture of the motion this one is shown.
HIGH, MOMENT, MOMENTS = 96, 2, 5
#: Settings that are in no column: of the machine, or names of rows. Lists and longer texts are in none either.
UNSHOWN, LONGEST = ("machine", "versions", "limits", "tasks", "distances", "residuals", "contacts", "plant"), 60
TITLE = "Runs in "
#: The verdict on a run whose metadata cannot be read.
UNREADABLE = "unreadable"
#: What stands first of the settings.
FIRST, PARAMETER = ("scenario", "robot"), "parameters."
#: When a run ended early, in what its metadata say of its end.
STOPPED = re.compile(r"\bt = (\d+(?:\.\d+)?) s")


def save_index(folder: Place) -> Path:
    """Write ``index.html`` into ``folder``: a table of the runs in it, and below it, that a click in a heading sorts.

    Only ``meta.json`` of each run is read, and the picture of its report. A run whose ``meta.json`` cannot be read
    has a row that says so. Links are relative: the folder can be moved.

    Raises:
        InvalidInput: no folder, no run in it, or an ``index.html`` that is not such a page.
        NotSupported: a package that reports need is not installed.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from wbc.report import save_index
        >>> from wbc.control.recorder import Run
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     for gain in (1.0, 4.0):
        ...         run = Run({"t": [0.0, 0.1]}, {"scenario": "reach", "parameters": {"gain": gain}})
        ...         _ = run.save(Path(folder) / f"gain {gain:g}")
        ...     page = save_index(folder)
        ...     page.name, ">gain</th>" in page.read_text(encoding="utf-8")
        ('index.html', True)
    """
    require_extras()
    target = located(folder)
    page = target / INDEX
    if page.is_file() and f"<title>{TITLE}" not in page.read_text(encoding="utf-8", errors="replace")[:1000]:
        raise InvalidInput(f"{page} is another page; it is not written over")
    text = html(index(target))
    with written(page) as pending:
        pending.write_text(text, encoding="utf-8")
    return page


def index(folder: Path) -> Report:
    """The page as data.

    Raises:
        InvalidInput: there is no run in the folder.
    """
    places = sorted(_folders(folder, DEEP))
    metas = {place: meta for place in places if (meta := _meta(place)) is not None}
    if not metas:
        raise InvalidInput(f"{folder} has no folder of a run in it: none with {ARRAYS_FILE} and {META_FILE}")
    flat = {place: _settings(meta) for place, meta in metas.items()}
    keys = dict.fromkeys(key for one in flat.values() for key in one)
    differing = [key for key in keys if len({one[key] for one in flat.values() if key in one}) > 1]
    differing = [key for key in differing if not _twice(key, [*flat.values()])]
    differing.sort(key=lambda key: (key not in FIRST, not key.startswith(PARAMETER)))
    rows: list[list[Cell]] = []
    for place, meta in metas.items():
        name = str(place.relative_to(folder)) if place != folder else folder.resolve().name
        page = (place / HTML).relative_to(folder).as_posix()
        link = Address(name, page) if (place / HTML).is_file() else name
        rows.append([_thumbnail(place), link, *_fate(meta), *(flat[place].get(key) for key in differing)])
    columns = (
        "",
        "run",
        "verdict",
        "not met",
        *(settings.setting_name(key.removeprefix(PARAMETER)) for key in differing),
    )
    same = [(key, next(iter(flat.values()))[key]) for key in keys if len({one.get(key) for one in flat.values()}) == 1]
    items = [
        Table(columns, rows, "Click a heading to sort. A dash: the run has no such setting.", sorts=True),
        *([Table(("setting", "in every run"), same, "Settings that do not differ", folded=True)] if same else []),
    ]
    others = [(Address(title, page),) for title, page in _others(folder, places, metas)]
    sections = [Section("Runs", items)]
    if others:
        sections.append(Section("Other pages", [Table(("page",), others)]))
    verdicts = [str(getattr(row[2], "text", row[2])) for row in rows]
    tiles = [Tile(what, str(verdicts.count(what)), mood) for what, mood in MOODS.items() if what in verdicts]
    unmade = sum(isinstance(row[1], str) for row in rows)
    summary = f"{plural(len(rows), 'run')}, as recorded in {META_FILE} of each."
    if unmade:
        summary += f" {unmade} {'have' if unmade > 1 else 'has'} no page yet; wbc report run FOLDER makes it."
    return Report(TITLE + folder.resolve().name, summary, None, sections, [Tile("runs", str(len(rows))), *tiles])


#: Verdicts, and how they are coloured.
MOODS: Mapping[str, str] = {"passed": "good", "failed": "bad", "not judged": "", UNREADABLE: "bad"}


def _folders(folder: Path, deep: int) -> Iterator[Path]:
    """The folder and those below it, but not what lies beside a run."""
    yield folder
    if deep:
        try:
            below = [path for path in folder.iterdir() if path.is_dir() and not path.is_symlink()]
        except OSError as cause:
            raise InvalidInput(f"{folder} cannot be read: {cause.strerror}") from cause
        for path in below:
            if path.name not in (BESIDE, FIGURES) and not path.name.startswith("."):
                yield from _folders(path, deep - 1)


def _meta(place: Path) -> Mapping[str, Any] | None:
    """The metadata of a run, or under ``UNREADABLE`` why they cannot be read; None where there is no run."""
    file = place / META_FILE
    if not (file.is_file() and (place / ARRAYS_FILE).is_file()):
        return None
    try:
        meta = checks.instance(str(file), read_json(str(file), file.read_bytes()), Mapping, "an object")
        check_metadata(str(file), meta)
    except InvalidInput as cause:
        return {UNREADABLE: str(cause).replace(str(file), META_FILE)}
    except OSError as cause:
        return {UNREADABLE: f"{META_FILE}: {cause.strerror}"}
    return meta


def _settings(meta: Mapping[str, Any]) -> dict[str, Cell]:
    kept = {key: value for key, value in meta.items() if key not in (UNREADABLE, *RESULTS, *UNSHOWN)}
    stopped = STOPPED.search(str(meta.get("ended", "")))
    kept = {"simulated" if key == "duration" else key: value for key, value in kept.items()}
    if stopped and "simulated" in kept:
        kept["simulated"] = float(stopped[1])
    return {
        key: neutral(value) for key, value in settings.flat(kept)
        if isinstance(value, bool | int | float) or (isinstance(value, str) and len(value) <= LONGEST)
    }  # fmt: skip


def _twice(key: str, runs: Sequence[Mapping[str, Cell]]) -> bool:
    """Whether a parameter, such as the robot, is what the run itself says."""
    own = key.removeprefix(PARAMETER)
    return own != key and all(one.get(own) == one[key] for one in runs if key in one)


def _fate(meta: Mapping[str, Any]) -> tuple[Cell, Cell]:
    """The verdict, and the demands that were not met, or why the run cannot be read."""
    if UNREADABLE in meta:
        return Marked(UNREADABLE, MOODS[UNREADABLE]), meta[UNREADABLE]
    judged = meta.get(JUDGED)
    if not isinstance(judged, Mapping):
        return "not judged", None
    demands = judged.get("verdict")
    failed = [
        str(demand.get("demand")) for demand in (demands if isinstance(demands, list) else [])
        if isinstance(demand, Mapping) and not demand.get("ok")
    ]  # fmt: skip
    word = "passed" if judged.get("ok") else "failed"
    return Marked(word, MOODS[word]), "; ".join(failed) or None


def _thumbnail(place: Path) -> Cell:
    """One moment of the picture of the motion in the run's report; nothing without one."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(place / FIGURES / MOTION) as picture:
            width, height = picture.size
            moment = picture.crop((width * MOMENT // MOMENTS, 0, width * (MOMENT + 1) // MOMENTS, height))
            small = moment.convert("RGB").resize((max(1, HIGH * moment.width // moment.height), HIGH))
    except (OSError, UnidentifiedImageError):
        return None
    memory = BytesIO()
    small.save(memory, "png", optimize=True)
    return Figure("motion", f"a moment of {place.name}", memory.getvalue(), "png")


def _others(folder: Path, places: list[Path], metas: Mapping[Path, Any]) -> Iterator[tuple[str, str]]:
    """Title and address of pages that are of no run: comparisons, sweeps."""
    for place in places:
        page = place / HTML
        if place not in metas and page.is_file():
            with page.open(encoding="utf-8", errors="replace") as file:
                title = re.search(r"<title>(.*?)</title>", file.read(1000))
            name = place.relative_to(folder).as_posix()
            yield f"{name}: {markup.unescape(title[1])}" if title else name, page.relative_to(folder).as_posix()
