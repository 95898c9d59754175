"""Body: how pelvis, chest, head and feet are turned, and when feet and hands hold, from where the joints are.

Axes of a part are those of a person who stands upright: x ahead, y to the left, z up. They come from the joints alone,

    pelvis   y along the hips, z near the line to the spine
    chest    y along the shoulders, z near the line from the hips
    foot     x along ankle and toes, less the slope of that line in standing; y level

so a file may use any axes for its bones. Where the file says how a part is turned, R_file(t), its turning is more
exact than that of few joints: then R(t) = R_file(t) R₀, with the constant R₀ nearest to R_file(t)ᵀ R_joints(t).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_closing, binary_opening
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInput
from wbc.motion.clip import NEEDED, Flags, Motion
from wbc.types import Mat, Vec

SIDES = ("left", "right")
#: A foot stands that is nearer to its height in standing [m] and slower [m/s] than this; a hand holds the ground.
_NEAR, _SLOW = 0.035, 0.22
_HAND = 0.12
#: Shorter gaps and shorter contacts are none [s].
_SHORT = 0.09
#: The share of frames in which a foot is supposed to stand when its height in standing is looked for.
_STANDING = 5.0


def posed(motion: Motion) -> Motion:
    """The same motion with ``rotations`` of pelvis, chest, feet and perhaps head in the axes of a person, and with
    ``contacts`` of feet and wrists; feet are called "left_foot" and "right_foot" there.

    Raises:
        InvalidInput: a part that is needed is missing.
    """
    p = motion.positions
    lacking = [part for part in NEEDED if part not in p]
    if lacking:
        raise InvalidInput(f"{motion.name} has no {', '.join(lacking)}; there are: {', '.join(p)}")
    hips, shoulders = (0.5 * (p[f"left_{part}"] + p[f"right_{part}"]) for part in ("hip", "shoulder"))
    turned = {
        "pelvis": _axes(p["left_hip"] - p["right_hip"], p.get("spine", shoulders) - hips),
        "chest": _axes(p["left_shoulder"] - p["right_shoulder"], shoulders - hips),
    }
    holds: dict[str, Flags] = {}
    for side in SIDES:
        ankle, toe, wrist = (p[f"{side}_{part}"] for part in ("ankle", "toe", "wrist"))
        heights = np.maximum(ankle[:, 2] - standing(ankle), toe[:, 2] - standing(toe))
        speeds = np.maximum(_speed(ankle, motion.rate), _speed(toe, motion.rate))
        stands = holds[f"{side}_foot"] = _said(motion, f"{side}_ankle", (heights < _NEAR) & (speeds < _SLOW))
        low = wrist[:, 2] < _HAND + standing(toe)
        holds[f"{side}_wrist"] = _said(motion, f"{side}_wrist", low & (_speed(wrist, motion.rate) < _SLOW))
        turned[f"{side}_foot"] = _foot(toe - ankle, stands)
    for part in ("pelvis", "head", *(f"{side}_ankle" for side in SIDES)):
        if part in motion.rotations:
            mine = part.replace("ankle", "foot")
            when = holds.get(mine, np.ones(motion.frames, dtype=bool))
            turned[mine] = _calibrated(motion.rotations[part], turned.get(mine, turned["chest"]), when)
    return replace(motion, rotations=turned, contacts=holds)


def standing(places: Mat) -> float:
    """The height of a part of a foot (N, 3) in standing [m]."""
    return float(np.percentile(places[:, 2], _STANDING))


def spans(held: Flags) -> list[tuple[int, int]]:
    """First frame and frame after the last of every run of frames in which something holds.

    Example:
        >>> import numpy as np
        >>> from wbc.motion.body import spans
        >>> spans(np.array([1, 1, 0, 1], dtype=bool))
        [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _speed(places: Mat, rate: float) -> Vec:
    return np.asarray(np.linalg.norm(np.gradient(places, axis=0), axis=1) * rate)


def _said(motion: Motion, part: str, found: Flags) -> Flags:
    """What the file says of a contact, else what was found, without gaps and contacts that are too short."""
    if part in motion.contacts:
        return np.asarray(motion.contacts[part], dtype=bool)
    size = np.ones(max(round(_SHORT * motion.rate), 1), dtype=bool)
    padded = np.pad(found, len(size), mode="edge")
    whole = binary_opening(binary_closing(padded, size), size)
    return np.asarray(whole[len(size) : -len(size)], dtype=bool)


def unit(v: Mat) -> Mat:
    """Directions (…, 3) of length 1."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9))


def _axes(y: Mat, up: Mat) -> Vec:
    """Rotations (N, 3, 3) with this y and a z near ``up``."""
    y = unit(y)
    x = unit(np.cross(y, up))
    return np.stack([x, y, np.cross(x, y)], axis=2)


def _foot(ahead: Mat, stands: Flags) -> Vec:
    """Rotations of a foot with y level, from the line (N, 3) of ankle and toes; level on average while it stands."""
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    slope = np.arctan2(ahead[:, 2], np.linalg.norm(ahead[:, :2], axis=1))
    level = float(np.median(slope[stands] if stands.any() else slope))
    return np.asarray(Rotation.from_euler("ZY", np.column_stack([heading, level - slope])).as_matrix())


def _calibrated(said: Vec, joints: Vec, when: Flags) -> Vec:
    """R_file(t) R₀ with the rotation R₀ that is nearest to R_file(t)ᵀ R_joints(t) on average over some frames."""
    own = Rotation.from_matrix(said)
    between = own.inv() * Rotation.from_matrix(joints)
    return np.asarray((own * (between[when] if when.any() else between).mean()).as_matrix())
