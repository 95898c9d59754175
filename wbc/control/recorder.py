"""Recorder and Run: what happened, column by column, in memory and on disk.

A :class:`Recorder` takes one row per tick and writes it into memory set aside beforehand. A :class:`Run` is the
result: named columns that all have the same number of rows, and metadata that says what they are. On disk a run is
a folder with ``run.npz`` (arrays, packed by :mod:`wbc.packing`, no pickle) and ``meta.json``.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from copy import deepcopy
from math import isnan
from pathlib import Path
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control.metadata import check_metadata, plain, with_more
from wbc.control.table import table
from wbc.errors import InvalidInput, NotSupported, UnknownName
from wbc.files import Place, located, made_folder, written
from wbc.npz import read_json, read_npz, write_arrays
from wbc.packing import restored, stored
from wbc.qp.problem import QP
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.control.command import Command
    from wbc.control.controller import Controller
    from wbc.control.setpoint import Setpoint
    from wbc.control.ticks import Ticks

ARRAYS_FILE = "run.npz"
META_FILE = "meta.json"
FAILED_FILE = "failed.npz"
#: Columns that have a number for each joint, perhaps behind those of a floating base.
_OF_JOINTS = frozenset({"q", "v", "a", "tau", "q_cmd", "v_cmd"})
MISSING_INTEGER = -1
#: The most rows that a recorder is made for.
MOST_ROWS = 10**9

Row = Mapping[str, "float | Vec"]
Column = NDArray[Any]


class UnknownColumn(UnknownName, KeyError):
    """No such column in the run."""

    kind = "column"
    __str__ = Exception.__str__  # KeyError would put the sentence in quotes


@final
class Run(Mapping[str, Column], metaclass=TellsArguments):
    """A record: a mapping from column name to array (N,) or (N, k), and ``meta``.

    Raises:
        InvalidInput: columns of different lengths.

    Example:
        >>> import numpy as np
        >>> from wbc.control.recorder import Run
        >>> run = Run({"t": np.arange(3) * 0.1, "q": np.zeros((3, 7))}, {"scenario": "arm-reach"})
        >>> run.rows, run["q"].shape, sorted(run)
        (3, (3, 7), ['q', 't'])
    """

    __slots__ = ("columns", "failed", "meta", "rows")

    def __init__(self, columns: Mapping[str, Any], meta: Mapping[str, Any] | None = None) -> None:
        for what, given in (("columns", columns), ("meta", {} if meta is None else meta)):
            checks.instance(what, given, Mapping, "a mapping of names")
        self.columns: dict[str, Column] = {name: np.asarray(values) for name, values in columns.items()}
        self.meta: dict[str, Any] = dict(meta or {})
        #: The QP of the first tick without an answer, saved beside the columns; ``wbc explain`` reads it.
        self.failed: QP | None = None
        lengths = {name: values.shape[0] if values.ndim else -1 for name, values in self.columns.items()}
        self.rows: int = next(iter(lengths.values()), 0)
        for name, length in lengths.items():
            if length != self.rows or length < 0:
                first = next(iter(lengths))
                raise InvalidInput(f"column {name!r} has {length} rows; {first!r} has {self.rows}: they must be equal")

    def __getitem__(self, name: str) -> Column:
        """The column called ``name``.

        Raises:
            UnknownColumn: with the names that are near.
        """
        try:
            return self.columns[name]
        except KeyError:
            raise UnknownColumn(name, self.columns) from None

    def matching(self, prefix: str) -> dict[str, Column]:
        """Columns whose names start with ``prefix``, keyed by what follows it: ``matching("error.")``."""
        return {name[len(prefix) :]: values for name, values in self.columns.items() if name.startswith(prefix)}

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    def __repr__(self) -> str:
        return f"Run({self.rows} rows, {len(self.columns)} columns, scenario={self.meta.get('scenario')!r})"

    def save(self, folder: Place) -> Path:
        """Write ``run.npz`` and ``meta.json`` into ``folder`` (made if needed) and return it.

        Columns are read back to the bit. Both files are complete before either takes its name, so a reader never sees
        half of one. Infinite numbers in ``meta`` are written as Python's json writes them (``Infinity``).

        Raises:
            InvalidInput: a column of objects, metadata that json cannot hold, or nothing can be written there.
        """
        for name, values in self.columns.items():
            if values.dtype.hasobject:
                raise InvalidInput(f"column {name!r} holds Python objects; a run holds numbers")
        arrays = stored(self.columns)
        text = json.dumps(plain("meta", self.meta), indent=1, ensure_ascii=False).encode()
        target = made_folder(folder)
        with written(target / META_FILE) as meta, written(target / ARRAYS_FILE) as packed_file:
            with packed_file.open("xb") as file:
                write_arrays(file, arrays)
            meta.write_bytes(text)
        if self.failed is not None:
            self.failed.save(target / FAILED_FILE)
        return target

    def ordered(self, joints: Any) -> Run:
        """The same run with its joints, or some of them, in another order, such as ``JointMap.joints``: q, v, a, τ and
        the commands, the plant's too. A floating base stays first.

        Raises:
            InvalidInput: a joint that the run has not; metadata without names of joints.

        Example:
            >>> from wbc.control.recorder import Run
            >>> run = Run({"t": [0.0], "q": [[1.0, 2.0]]}, {"joint_names": ["elbow", "slide"]})
            >>> run.ordered(["slide", "elbow"])["q"]
            array([[2., 1.]])
        """
        names = [str(name) for name in self.meta.get("joint_names", ())]
        chosen = checks.names("joints", joints, names)
        order = [names.index(name) for name in chosen]
        columns = dict(self.columns)
        for name, values in self.columns.items():
            if name.removeprefix("plant.") in _OF_JOINTS and (base := values.shape[1] - len(names)) >= 0:
                columns[name] = np.hstack([values[:, :base], values[:, base:][:, order]])
        units = list(self.meta.get("joint_units") or ())
        about = {"joint_names": list(chosen)} | ({"joint_units": [units[j] for j in order]} if units else {})
        return Run(columns, {**self.meta, **about})

    def to_csv(self, path: Place) -> Path:
        """Write a table of all columns: a heading with component and unit (:mod:`wbc.control.table`), a row a tick.

        Numbers are written so that they are read back to the bit; NaN is an empty cell. UTF-8.

        Raises:
            InvalidInput: the file cannot be written there.

        Example:
            >>> import tempfile
            >>> from pathlib import Path
            >>> from wbc.control.recorder import Run
            >>> about = {"joint_names": ["elbow", "slide"], "joint_units": ["rad", "m"]}
            >>> run = Run({"t": [0.0, 0.1], "q": [[1.0, 2.0], [1.5, 2.5]]}, about)
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     print(run.to_csv(Path(folder) / "run.csv").read_text(encoding="utf-8"))
            t [s],q.elbow [rad],q.slide [m]
            0.0,1.0,2.0
            0.1,1.5,2.5
        """
        columns = table(self.columns, self.meta)
        with written(path) as aside, aside.open("x", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            for row in zip(*(values.tolist() for values in columns.values()), strict=True):
                writer.writerow(["" if isinstance(value, float) and isnan(value) else value for value in row])
        return Path(path)

    def to_pandas(self) -> Any:
        """The same table as a ``pandas.DataFrame``.

        Raises:
            NotSupported: pandas is not installed.
        """
        try:
            import pandas
        except ImportError as cause:
            raise NotSupported("a table of pandas needs it; pip install pandas") from cause
        return pandas.DataFrame(table(self.columns, self.meta))

    @classmethod
    def load(cls, folder: Place) -> Run:
        """Read what :meth:`save` wrote. Never unpickles.

        Raises:
            InvalidInput: the folder or a file is not there, or is not a run; the message names it.
        """
        source = located(folder)
        for file in (ARRAYS_FILE, META_FILE):
            if not (source / file).is_file():
                raise InvalidInput(f"{source} is not the folder of a run: it has no {file}")
        columns = restored(source / ARRAYS_FILE, read_npz(source / ARRAYS_FILE))
        meta = read_json(str(source / META_FILE), (source / META_FILE).read_bytes())
        if not isinstance(meta, dict):
            raise InvalidInput(f"{source / META_FILE} must hold an object, not a {type(meta).__name__}")
        check_metadata(str(source / META_FILE), meta)
        return cls(columns, meta)


@final
class Recorder(metaclass=TellsArguments):
    """Columns in memory set aside for ``capacity`` rows; the first row decides their names and shapes.

    A value is a number or an array (k,), kept as float64. A column that a later row leaves out is NaN there (-1 for
    integers). A column is of integers if that of the first row is one and all others are whole and below 2^53, beyond
    which they are rounded. More rows than ``capacity`` are kept too, in further memory of that size; ``grown`` counts
    how often. Memory is set aside without being written, and no row is ever moved, so that a loop in real time has no
    long tick for it.

    In a loop of your own call :meth:`tick` instead of the controller's: it times the tick and records it.
    :func:`wbc.report.save_report` makes a report of the run.

    Example:
        >>> from wbc.control.recorder import Recorder
        >>> recorder = Recorder(100)
        >>> recorder.append({"t": 0.0, "status": 0, "q": [1.0, 2.0]})
        >>> recorder.append({"t": 0.1, "status": 0})
        >>> recorder.run({})["q"].tolist()
        [[1.0, 2.0], [nan, nan]]
    """

    __slots__ = ("_full", "_integers", "_memory", "_place", "_ticks", "capacity", "rows")

    def __init__(self, capacity: int) -> None:
        if hasattr(capacity, "tick"):
            raise InvalidInput("Recorder takes a number of rows, and its tick(controller, t, q, v) the controller")
        self.capacity = int(checks.number("capacity", capacity, low=1, high=MOST_ROWS))
        if self.capacity != capacity:
            raise InvalidInput(f"capacity is {capacity!r}; it must be a whole number of rows, at least 1")
        self.rows = 0
        #: The rows before those that are written into now.
        self._full: list[Mat] = []
        self._memory: Mat = np.empty((self.capacity, 0))
        #: Where each column stands in a row.
        self._place: dict[str, int | slice] = {}
        self._integers = frozenset[str]()
        self._ticks: Ticks | None = None

    def __copy__(self) -> Recorder:
        """The same as ``copy.deepcopy``: a copy has rows of its own."""
        return deepcopy(self)

    def tick(self, controller: Controller | Setpoint, t: float, q: Vec, v: Vec, **more: float | Vec) -> Command:
        """Call ``controller.tick(t, q, v)``, time it, record its arguments and its command, and return the command.

        The first tick fixes the controller and, by its stack, the columns. If another stack replaces this one, only
        columns of these names and sizes are recorded.

        ``more`` are columns of your own: numbers or arrays (k,). The first tick fixes their names and sizes; later ones
        may leave some out. No name may be one that the recorder writes at some level
        (:data:`wbc.control.ticks.COLUMNS`). What a plant knows may be added for reports: ``plant.q`` (nq,), ``plant.v``
        (nv,), ``plant.tau`` (nj,).

        Raises:
            InvalidInput: another controller than before, or q or v of another shape; before the controller decides, one
                of ``more`` with a name of the recorder's, or of another size.
            UnknownColumn: before the controller decides, one of ``more`` that the first tick did not have.

        Example:
            >>> import numpy as np, wbc
            >>> from wbc.tasks import JointVelocityLimits, Position
            >>> robot = wbc.load("arm")
            >>> stack = wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[JointVelocityLimits()])
            >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel())
            >>> recorder, q = wbc.Recorder(100), robot.q0
            >>> for k in range(100):
            ...     q = recorder.tick(controller, 1e-3 * k, q, np.zeros(robot.nv), battery=48.0).q
            >>> run = recorder.run()
            >>> run.rows, run["error.Position[tool]"].shape, float(run["battery"][0]), run.meta["robot"]
            (100, (100, 3), 48.0, 'arm')
        """
        from wbc.control.controller import Controller
        from wbc.control.setpoint import Setpoint
        from wbc.control.ticks import Ticks

        decides = controller.controller if isinstance(controller, Setpoint) else controller
        checks.instance("controller", decides, Controller, "a wbc.Controller or wbc.Setpoint")
        if self._ticks is None:
            self._ticks = Ticks(decides)
        if self._ticks.controller is not decides:
            raise InvalidInput("a recorder takes the ticks of one controller; make another recorder for this one")
        self._ticks.refuse(more)
        for name in more if self.rows else ():
            self._checked(name, more[name])
        start = perf_counter_ns()
        command = controller.tick(t, q, v)
        microseconds = (perf_counter_ns() - start) / 1000.0
        row = self._ticks.row(float(t), np.asarray(q), np.asarray(v), command, microseconds)
        self.append(row | more)
        self._ticks.watch(float(t))
        return command

    def append(self, row: Row) -> None:
        """Keep one row.

        Raises:
            UnknownColumn: a column that the first row did not have.
            InvalidInput: another shape than in the first row, or not a number.
        """
        i = self.rows - len(self._full) * self.capacity
        if self.rows == 0:
            self._lay_out(row)
        elif i == self.capacity:
            self._full.append(self._memory)
            self._memory, i = np.empty_like(self._memory), 0
        numbers = self._memory[i]
        numbers[:] = np.nan
        for name, value in row.items():
            numbers[self._place[name]] = self._checked(name, value)
        self.rows += 1  # a row that is refused half-way does not count

    def run(self, meta: Mapping[str, Any] | None = None) -> Run:
        """The rows so far as a :class:`Run`; the recorder may go on, and another thread may be recording meanwhile.

        ``meta`` is added to the metadata of the controller. Of these it may replace the robot's name alone: the others
        say how the columns are to be read.

        Raises:
            InvalidInput: metadata that the controller's ticks say, or of another kind than reports read, by name.
        """
        meta = {} if meta is None else checks.instance("meta", meta, Mapping, "a mapping of names")
        n, places, memory = self.rows, self._place, self._memory  # in this order: rows may come in meanwhile
        parts = [part[: max(0, n - k * self.capacity)] for k, part in enumerate([*self._full, memory])]
        columns = {name: np.concatenate([part[:, place] for part in parts]) for name, place in places.items()}
        columns |= {name: _whole(columns[name]) for name in self._integers & columns.keys()}
        if self._ticks is None:
            return Run(columns, with_more({}, meta))
        from wbc.control.ticks import about

        ticks = self._ticks
        known = about(ticks.controller) | ticks.found() | {"duration": n * ticks.controller.dt}
        run = Run(columns, with_more(known, meta))
        run.failed = ticks.failed
        return run

    def _lay_out(self, row: Row) -> None:
        """Set memory aside for rows like the first."""
        places: dict[str, int | slice] = {}
        width = 0
        for name, value in row.items():
            shape = np.shape(value)
            if len(shape) > 1:
                raise InvalidInput(f"column {name!r} has shape {shape}; a value is a number or (k,)")
            end = width + (shape[0] if shape else 1)
            places[name] = slice(width, end) if shape else width
            width = end
        self._integers = frozenset(name for name, value in row.items() if isinstance(value, int | np.integer))
        self._memory, self._place = np.empty((self.capacity, width)), places

    def _checked(self, name: str, value: float | Vec) -> Vec:
        if name not in self._place:
            raise UnknownColumn(name, self._place, "columns are fixed by the first row")
        place = self._place[name]
        wanted = (place.stop - place.start,) if type(place) is slice else ()
        try:
            result = np.asarray(value, np.float64)
        except (TypeError, ValueError, OverflowError) as cause:
            raise InvalidInput(f"column {name!r} must hold numbers, not {checks.shown(value)}") from cause
        if result.shape != wanted:
            raise InvalidInput(f"column {name!r} has shape {wanted}, fixed by the first row; not {result.shape}")
        return result

    @property
    def grown(self) -> int:
        """The number of times that memory for ``capacity`` more rows was added."""
        return len(self._full)


def _whole(values: Vec) -> Column:
    """``values`` as integers, where they are whole and were not rounded."""
    missing = np.isnan(values)
    if not (missing | (np.abs(values) < 2.0**53) & (np.rint(values) == values)).all():
        return values
    return np.where(missing, MISSING_INTEGER, values).astype(np.int64)
