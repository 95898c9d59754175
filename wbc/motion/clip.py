"""Motion: where the parts of a body are, moment by moment; read from BVH, .npz or .csv files, or made of arrays."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from wbc import checks
from wbc.errors import InvalidInput, UnknownName
from wbc.files import Place, located
from wbc.motion.bvh import Read, read_bvh
from wbc.npz import read_npz, write_npz
from wbc.tolerances import MET
from wbc.types import Flags, Mat, Vec

SIDES = ("left", "right")
#: Parts of a body that retargeting knows, and what files call them, without case, blanks and prefixes; the first name
#: that a file has is meant. A file that has an ankle and a foot calls the toes foot, so a name is taken once, in this
#: order; one that has an arm and a shoulder calls the collar bone shoulder.
PARTS: Mapping[str, tuple[str, ...]] = {
    "pelvis": ("pelvis", "hips", "hip", "root"),
    "spine": ("spine", "spine1", "lowerback", "abdomen", "torso", "chest"),
    "head": ("head",),
    **{
        f"{side}_{part}": tuple(f"{start}{name}" for name in names for start in (side, side[0]))
        for side in SIDES
        for part, names in {
            "hip": ("hip", "upleg", "thigh", "upperleg"),
            "knee": ("knee", "leg", "lowleg", "lowerleg", "shin", "calf"),
            "ankle": ("ankle", "foot"),
            "toe": ("toe", "toebase", "toes", "foot"),
            "shoulder": ("arm", "uparm", "upperarm", "shoulder"),
            "elbow": ("elbow", "forearm", "lowarm", "lowerarm"),
            "wrist": ("wrist", "hand"),
        }.items()
    },
}
#: Parts without which nothing can be retargeted, and the lines between parts that show a body.
NEEDED = tuple(part for part in PARTS if part not in ("pelvis", "spine", "head"))
_CHAINS = ("shoulder", "elbow", "wrist"), ("shoulder", "hip", "knee", "ankle", "toe")
BONES = (
    ("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("spine", "head"),
    *((f"{s}_{one}", f"{s}_{other}") for s in SIDES for chain in _CHAINS for one, other in pairwise(chain)),
)  # fmt: skip
#: Metres in the units in which files give lengths, and how tall a body is in the right one [m]. Of two that are
#: possible (64 is 0.64 m or 1.63 m) the one is right that is nearer to the middle, by ratio.
_UNITS = (1.0, 0.01, 0.0254, 0.001)
_TALL = (0.6, 2.6)
#: The numbers that a motion has of a part in each frame, and their shapes.
_SHAPES = {"positions": (3,), "rotations": (3, 3), "contacts": ()}


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of N frames at ``rate`` [1/s]: ``positions`` {part: (N, 3)} [m], z up, the floor at z = 0.

    ``rotations`` {part: (N, 3, 3)} are those of the parts that have one; of a person's each is in axes of its own that
    do not move in the part: only how they turn is read. ``contacts`` {part: (N,)} says when a part holds, for the parts
    of which the file says it; of the others it is found in the motion (:mod:`wbc.motion.targets`). A foot holds as its
    ankle does.

    Raises:
        InvalidInput: fewer than three frames, arrays of other shapes, numbers that are not finite, a rate that is not
            positive.

    Example:
        >>> from wbc.motion import made
        >>> motion = made("squat")
        >>> motion.frames, motion.rate, motion.positions["left_wrist"].shape
        (240, 60.0, (240, 3))
    """

    rate: float
    positions: Mapping[str, Mat]
    rotations: Mapping[str, Vec] = field(default_factory=dict)
    contacts: Mapping[str, Flags] = field(default_factory=dict)
    name: str = "motion"

    def __post_init__(self) -> None:
        checks.number("rate", self.rate, low=0.0, strict=True)
        for key in _SHAPES:
            checks.instance(key, getattr(self, key), Mapping, "arrays by the names of parts")
        sizes = {len(checks.array(f"{self.name}: {part}", p, (None, 3))) for part, p in self.positions.items()} or {0}
        if len(sizes) != 1 or min(sizes) < 3:
            said = " and ".join(map(str, sorted(sizes)))
            raise InvalidInput(f"{self.name} has parts of {said} frames; all must have as many, at least three")
        for key, shape in _SHAPES.items():
            for part, values in (found := dict(getattr(self, key))).items():
                found[part] = checks.array(f"{self.name}: {key}[{part}]", values, (*sizes, *shape))
            object.__setattr__(self, key, found)
        for part, r in self.rotations.items():
            if np.abs(r @ r.transpose(0, 2, 1) - np.eye(3)).max() > MET or np.linalg.det(r).min() < 0.0:
                raise InvalidInput(f"{self.name}: rotations[{part}] are no rotations to 1e-6")
        object.__setattr__(self, "contacts", {part: held > 0.5 for part, held in self.contacts.items()})

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(next(iter(self.positions.values())))

    @property
    def times(self) -> Vec:
        """Time (N,) of each frame [s], from 0."""
        return np.arange(self.frames) / self.rate

    @classmethod
    def read(cls, path: Place) -> Self:
        """The motion in a file: ``.bvh``; ``.npz`` with ``names`` (F,), ``positions`` (N, F, 3) [m], ``rate`` and
        perhaps ``rotations`` (N, F, 3, 3) and ``contacts`` (N, F); or ``.csv`` with a column ``time`` [s] and columns
        ``PART.x``, ``PART.y``, ``PART.z``. Centimetres, inches and millimetres are found by the size of the body.

        Raises:
            InvalidInput: no such file, or not such a file; the message says where it is wrong.
        """
        place = located(path)
        reader = {".bvh": read_bvh, ".npz": _arrays, ".csv": _table}.get(place.suffix.lower())
        if reader is None:
            raise InvalidInput(f"{place} is no motion that can be read; give a .bvh, .npz or .csv file")
        if not place.exists():
            raise InvalidInput(f"{place} cannot be read: there is no such file")
        rate, given = reader(place)
        name, positions = place.stem, given["positions"]
        called = known_parts(name, [*positions])
        heights = [checks.array(f"{name}: {one}", positions[one], (None, 3))[:, 2] for one in called.values()]
        tall = float(np.median(np.ptp(heights, axis=0)))
        possible = [unit for unit in _UNITS if _TALL[0] <= unit * tall <= _TALL[1]]
        if not possible:
            raise InvalidInput(f"{name}: the body is {tall:g} tall, which is no person's size in m, cm, inches or mm")
        metres = min(possible, key=lambda unit: abs(float(np.log(unit * tall) - np.log(_TALL).mean())))
        given["positions"] = {one: metres * p for one, p in positions.items()}
        kept: Any = {key: {part: of[one] for part, one in called.items() if one in of} for key, of in given.items()}
        return cls(rate, **kept, name=name)

    def at(self, moments: Vec) -> Self:
        """The same motion at other moments (M,), in frames from 0 to N − 1: what is between frames by cubic splines,
        contacts as in the nearest frame.

        Raises:
            InvalidInput: moments of another shape, or out of the motion.

        Example:
            >>> import numpy as np
            >>> from wbc.motion import made
            >>> made("squat").at(np.linspace(0.0, 239.0, 479)).frames  # at half the pace
            479
        """
        moments = checks.array("moments", moments, (None,))
        if moments.size and not 0.0 <= moments.min() <= moments.max() <= self.frames - 1:
            raise InvalidInput(f"moments must be between 0 and {self.frames - 1}, the frames of {self.name}")
        frames, nearest = np.arange(self.frames), np.rint(moments).astype(np.intp)
        turns = {part: RotationSpline(frames, Rotation.from_matrix(r)) for part, r in self.rotations.items()}
        return replace(
            self,
            positions={part: CubicSpline(frames, p)(moments) for part, p in self.positions.items()},
            rotations={part: turn(moments).as_matrix() for part, turn in turns.items()},
            contacts={part: held[nearest] for part, held in self.contacts.items()},
        )

    def save(self, path: Place) -> None:
        """Write a ``.npz`` file that ``read`` reads; a part without rotations or contacts has columns of NaN."""
        columns: dict[str, Any] = {
            key: np.stack([given.get(part, np.full((self.frames, *shape), np.nan)) * 1.0 for part in self.positions], 1)
            for key, shape in _SHAPES.items()
            if (given := getattr(self, key))
        }
        write_npz(path, names=[*self.positions], rate=self.rate, **columns)


def _arrays(place: Path) -> Read:
    arrays = read_npz(place)
    if lacking := [key for key in ("names", "positions", "rate") if key not in arrays]:
        raise InvalidInput(f"{place} has no array {lacking[0]!r}; there are: {', '.join(arrays) or 'none'}")
    if arrays["names"].ndim != 1 or arrays["names"].dtype.kind != "U" or arrays["rate"].size != 1:
        raise InvalidInput(f"{place}: names must be text (F,), and rate one number")
    names = arrays["names"].tolist()
    _once(place, names)
    found: dict[str, dict[str, Vec]] = {}
    for key, shape in _SHAPES.items():
        values = arrays.get(key, np.zeros((0, len(names), *shape)))
        if values.dtype.kind not in "fiub" or values.shape[1:] != (len(names), *shape):
            said = ", ".join(map(str, (len(names), *shape)))
            raise InvalidInput(f"{place}: {key} must be numbers of shape (N, {said})")
        columns = zip(names, np.moveaxis(values, 1, 0), strict=True)
        found[key] = {name: column for name, column in columns if not np.isnan(column).all()}
    return checks.number(f"{place}: rate", arrays["rate"].item(), low=0.0, strict=True), found


def _table(place: Path) -> Read:
    rows: list[list[float]] = []
    try:
        lines = csv.reader(place.read_text(encoding="utf-8-sig").splitlines())
        heads = next(filter(None, lines), [])
        for cells in filter(None, lines):
            if len(cells) != len(heads):
                raise ValueError(f"line {lines.line_num} has {len(cells)} cells, the heading {len(heads)}")
            rows.append([float(cell) for cell in cells])
    except (OSError, ValueError, csv.Error) as cause:
        raise InvalidInput(f"{place} is no table of numbers with a heading: {cause}") from None
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(heads))
    _once(place, heads)
    columns, parts = dict(zip(heads, table.T, strict=True)), [one[:-2] for one in heads if one.endswith(".x")]
    try:
        steps = np.diff(columns["time"])
        positions = {part: np.column_stack([columns[f"{part}.{axis}"] for axis in "xyz"]) for part in parts}
    except KeyError as lacking:
        raise InvalidInput(f"{place} has no column {lacking}") from None
    if not steps.size or not steps.min() > 0.0 or np.abs(steps - steps.mean()).max() > 0.1 * steps.mean():
        raise InvalidInput(f"{place}: times must rise in even steps")
    return 1.0 / float(steps.mean()), {"positions": positions}


def _once(place: Path, names: list[str]) -> None:
    if twice := [name for name in names if names.count(name) > 1]:
        raise InvalidInput(f"{place} has two columns called {twice[0]!r}")


def known_parts(name: str, given: list[str]) -> dict[str, str]:
    """{part: what a file calls it} for the parts that are found in the names of a file.

    Raises:
        UnknownName: a part that is needed is not found.

    Example:
        >>> from wbc.motion.clip import PARTS, known_parts
        >>> found = known_parts("clip", [f"mixamorig:{part}" for part in PARTS] + ["LeftHandThumb1"])
        >>> found["left_wrist"]
        'mixamorig:left_wrist'
    """
    plain = {"".join(c for c in one.rpartition(":")[2].lower() if c.isalnum()): one for one in reversed(given)}
    found: dict[str, str] = {}
    for part, names in PARTS.items():
        free = [plain[one] for one in names if plain.get(one) not in (None, *found.values())]
        if free:
            found[part] = free[0]
        elif part in NEEDED:
            raise UnknownName(part, given, f"a part of the body that {name} needs; known names: {', '.join(names)}")
    return found
