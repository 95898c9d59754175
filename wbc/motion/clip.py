"""Motion: where the parts of a body are, moment by moment; read from BVH, .npz or .csv files, or made of arrays."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from wbc import checks
from wbc.errors import InvalidInput, UnknownName
from wbc.files import Place, located, written
from wbc.motion.bvh import read_bvh
from wbc.npz import read_npz
from wbc.tolerances import MET
from wbc.types import Mat, Vec

#: Parts of a body that retargeting knows, and what files call them, without case, blanks and prefixes. A file that has
#: an ankle and a foot calls the toes foot, so a name is taken once, in this order.
PARTS: Mapping[str, tuple[str, ...]] = {
    "pelvis": ("pelvis", "hips", "hip", "root"),
    "spine": ("spine", "spine1", "lowerback", "abdomen", "torso", "chest"),
    "head": ("head",),
    **{
        f"{side}_{part}": tuple(f"{start}{name}" for name in names for start in (side, side[0]))
        for side in ("left", "right")
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
BONES = (
    ("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("spine", "head"),
    *((f"{side}_{one}", f"{side}_{other}") for side in ("left", "right") for one, other in pairwise(
        ("shoulder", "elbow", "wrist")
    )),
    *((f"{side}_{one}", f"{side}_{other}") for side in ("left", "right") for one, other in pairwise(
        ("shoulder", "hip", "knee", "ankle", "toe")
    )),
)  # fmt: skip
#: Metres in the units in which files give lengths, tried in this order, and what the body is then tall [m].
_UNITS = (1.0, 0.01, 0.0254)
_TALL = (0.6, 2.6)
_LEAST_FRAMES = 3


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of N frames at ``rate`` [1/s]: ``positions`` {part: (N, 3)} [m], z up, the floor at z = 0.

    ``rotations`` {part: (N, 3, 3)} are those of the parts that have one, each in axes of its own that do not move in
    the part: only how they turn is read. ``contacts`` {part: (N,)} says when a part holds, for the parts of which the
    file says it; of the others it is found in the motion (:mod:`wbc.motion.contacts`).

    Raises:
        InvalidInput: fewer than three frames, arrays of other shapes, numbers that are not finite, a part that is
            missing, a rate that is not positive.

    Example:
        >>> from wbc.motion import made
        >>> motion = made("squat")
        >>> motion.frames, motion.rate, motion.positions["left_wrist"].shape
        (240, 60.0, (240, 3))
    """

    rate: float
    positions: Mapping[str, Mat]
    rotations: Mapping[str, Vec] = field(default_factory=dict)
    contacts: Mapping[str, Vec] = field(default_factory=dict)
    name: str = "motion"

    def __post_init__(self) -> None:
        checks.number("rate", self.rate, low=0.0, strict=True)
        lacking = [part for part in NEEDED if part not in self.positions]
        if lacking:
            raise InvalidInput(f"{self.name} has no {', '.join(lacking)}; there are: {', '.join(self.positions)}")
        found = {part: checks.array(f"positions[{part}]", p, (None, 3)) for part, p in self.positions.items()}
        sizes = {len(p) for p in found.values()}
        if len(sizes) != 1 or min(sizes) < _LEAST_FRAMES:
            said = " and ".join(map(str, sorted(sizes)))
            raise InvalidInput(f"{self.name} has parts of {said} frames; all must have as many, at least three")
        n = sizes.pop()
        object.__setattr__(self, "positions", found)
        turned = {part: checks.array(f"rotations[{part}]", r, (n, 3, 3)) for part, r in self.rotations.items()}
        for part, r in turned.items():
            if np.abs(np.einsum("nij,nkj->nik", r, r) - np.eye(3)).max() > MET or np.linalg.det(r).min() < 0.0:
                raise InvalidInput(f"rotations[{part}] of {self.name} are no rotations to 1e-6")
        object.__setattr__(self, "rotations", turned)
        held = {part: checks.array(f"contacts[{part}]", c, (n,)) > 0.5 for part, c in self.contacts.items()}
        object.__setattr__(self, "contacts", held)

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
        ``PART.x``, ``PART.y``, ``PART.z``. Lengths in centimetres and inches are found by the size of the body.

        Raises:
            InvalidInput: no such file, or not such a file; the message says where it is wrong.
        """
        place = located(path)
        match place.suffix.lower():
            case ".bvh":
                rate, positions, rotations = read_bvh(place)
                up = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # y up and z ahead there
                turned = {name: up @ r @ up.T for name, r in rotations.items()}
                return cls._of(place.stem, rate, {name: p @ up.T for name, p in positions.items()}, turned, {})
            case ".npz":
                return cls._of_arrays(place)
            case ".csv":
                return cls._of_table(place)
            case _:
                raise InvalidInput(f"{place} is no motion that can be read; give a .bvh, .npz or .csv file")

    def at(self, moments: Vec) -> Self:
        """The same motion at other moments (M,), in frames from 0 to N − 1: what is between frames by cubic splines.

        Example:
            >>> import numpy as np
            >>> from wbc.motion import made
            >>> made("squat").at(np.linspace(0.0, 239.0, 479)).frames  # at half the pace
            479
        """
        places, turned, held = (
            {part: between(values, moments) for part, values in one.items()}
            for one in (self.positions, self.rotations, self.contacts)
        )
        return replace(self, positions=places, rotations=turned, contacts=held)

    def save(self, path: Place) -> None:
        """Write a ``.npz`` file that ``read`` reads."""
        names = list(self.positions)
        columns: dict[str, Any] = {"positions": np.stack([self.positions[name] for name in names], axis=1)}
        n = self.frames
        if self.rotations:
            missing = np.full((n, 3, 3), np.nan)
            columns["rotations"] = np.stack([self.rotations.get(name, missing) for name in names], axis=1)
        if self.contacts:
            unknown = np.full(n, np.nan)
            columns["contacts"] = np.stack([self.contacts.get(name, unknown) * 1.0 for name in names], axis=1)
        with written(path) as aside, aside.open("wb") as file:
            np.savez_compressed(file, names=np.array(names), rate=np.array(self.rate), **columns)

    @classmethod
    def _of_arrays(cls, place: Path) -> Self:
        arrays = read_npz(place)
        for key in ("names", "positions", "rate"):
            if key not in arrays:
                raise InvalidInput(f"{place} has no array {key!r}; there are: {', '.join(arrays) or 'none'}")
        if arrays["names"].ndim != 1 or arrays["names"].dtype.kind != "U" or arrays["rate"].size != 1:
            raise InvalidInput(f"{place}: names must be text (F,), and rate one number")
        names = [str(name) for name in arrays["names"]]
        rate = checks.number("rate", arrays["rate"].reshape(()).item(), low=0.0, strict=True)
        size = len(names)
        shapes = {"positions": (0, size, 3), "rotations": (0, size, 3, 3), "contacts": (0, size)}
        found: dict[str, dict[str, Vec]] = {}
        for key, shape in shapes.items():
            values = arrays.get(key)
            if values is not None and (values.dtype.kind not in "fiub" or values.shape[1:] != shape[1:]):
                raise InvalidInput(f"{place}: {key} must be numbers of shape (N, {', '.join(map(str, shape[1:]))})")
            columns = {} if values is None else {name: 1.0 * values[:, k] for k, name in enumerate(names)}
            # A part without rotations or contacts has a column of NaN.
            found[key] = {name: column for name, column in columns.items() if not np.isnan(column).all()}
        return cls._of(place.stem, rate, found["positions"], found["rotations"], found["contacts"])

    @classmethod
    def _of_table(cls, place: Path) -> Self:
        try:
            rows = list(csv.reader(StringIO(place.read_text(encoding="utf-8"))))
            heads, table = rows[0], np.array(rows[1:], dtype=np.float64).reshape(-1, len(rows[0]))
        except (OSError, ValueError, IndexError, csv.Error) as cause:
            raise InvalidInput(f"{place} is no table of numbers with a heading: {cause}") from None
        if "time" not in heads or len(table) < _LEAST_FRAMES:
            raise InvalidInput(f"{place} needs a column 'time' and at least three rows")
        t = table[:, heads.index("time")]
        step = float(np.diff(t).mean())
        if not step > 0.0 or np.abs(np.diff(t) - step).max() > 0.1 * step:
            raise InvalidInput(f"{place}: times must rise in even steps")
        parts = [head[:-2] for head in heads if head.endswith(".x")]
        lacking = [f"{part}.{axis}" for part in parts for axis in "yz" if f"{part}.{axis}" not in heads]
        if lacking:
            raise InvalidInput(f"{place} has no column {lacking[0]!r}")
        positions = {part: table[:, [heads.index(f"{part}.{axis}") for axis in "xyz"]] for part in parts}
        return cls._of(place.stem, 1.0 / step, positions, {}, {})

    @classmethod
    def _of(
        cls, name: str, rate: float, positions: Mapping[str, Mat], rotations: Mapping[str, Vec],
        contacts: Mapping[str, Vec],
    ) -> Self:  # fmt: skip
        """From what a file calls its parts and in its unit of length."""
        called = known_parts(name, list(positions))
        cloud = np.stack([checks.array(f"{name}: {one}", positions[one], (None, 3)) for one in called.values()])
        tall = float(np.median(np.ptp(cloud[:, :, 2], axis=0)))
        metres = next((unit for unit in _UNITS if _TALL[0] <= unit * tall <= _TALL[1]), None)
        if metres is None:
            raise InvalidInput(
                f"{name}: the body is {tall:g} tall, which is in none of m, cm and inches a person's size"
            )
        placed = {part: metres * positions[one] for part, one in called.items()}
        turned = {part: rotations[one] for part, one in called.items() if one in rotations}
        held = {part: contacts[one] for part, one in called.items() if one in contacts}
        return cls(rate, placed, turned, held, name)


def between(values: Any, moments: Vec) -> Any:
    """Values (N, …) of frames at moments: flags of the nearest frame, rotations (N, 3, 3), and numbers by splines."""
    frames = np.arange(len(values))
    if values.dtype == np.bool_:
        return values[np.rint(moments).astype(np.intp)]
    if values.shape[1:] == (3, 3):
        return np.asarray(RotationSpline(frames, Rotation.from_matrix(values))(moments).as_matrix())
    return np.asarray(CubicSpline(frames, values)(moments))


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
        for called in (part.replace("_", ""), *names):
            if called in plain and plain[called] not in found.values():
                found[part] = plain[called]
                break
        else:
            if part in NEEDED:
                raise UnknownName(part, given, f"a part of the body that {name} needs; known names: {', '.join(names)}")
    return found
