"""Pace: how much slower a part of a motion has to be, where its speed asks for forces that the robot cannot give.

At r times the pace a frame has the velocity r v and the acceleration r² a at the same configuration. What it needs then
lies on the line from what it needs at rest to what it needs at its own pace:

    M (r² a) + h(q, r v) = g + r² (M a + h − g)

Forces that are possible form a convex set. A frame that is possible at the least pace is so up to one r, found by
bisection; one that is not has faults which no timing mends. The pace changes slowly from frame to frame, so that its
own change asks for little: ṙ v is not in the equation.

Source: J. M. Hollerbach, Dynamic scaling of manipulator trajectories, ASME Journal of Dynamic Systems, Measurement, and
Control 106(1), 1984.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import minimum_filter1d
from scipy.signal.windows import hann

from wbc.motion.forces import lacking
from wbc.motion.judged import Judged
from wbc.motion.kinematics import velocities
from wbc.motion.verdict import FORCES
from wbc.types import Vec

#: The pace at which timing has to help, the least at once, the share of what was found that is used, and how often
#: what lies between is halved.
_LEAST, _AT_ONCE, _MARGIN, _HALVINGS = 0.2, 0.7, 0.97, 6
#: Within so many seconds the pace comes down to what a frame needs, and up again.
_AROUND = 0.3
#: A sum of frames is whole up to this.
_ROUNDING = 1e-9


def possible_pace(found: Judged) -> Vec:
    """The share of its pace (N,) at which each frame is possible, at least 0.7; 1 where it is, or no pace helps."""
    v, a, _ = velocities(found.robot, found.q, found.rate)
    state, pace = found.robot.state(), np.ones(len(found.q))
    for k, verdict in enumerate(found.verdicts):
        contacts = [*found.held(k).values()]
        if verdict.certified or not contacts or not {fault.kind for fault in verdict.faults} <= FORCES:
            continue
        low, middle, high = 0.0, _LEAST**2, 1.0  # of its square
        for _ in range(_HALVINGS):
            state.update(0.0, found.q[k], middle**0.5 * v[k])
            if lacking(found.robot, state, middle * a[k], contacts)[0]:
                high = middle
            else:
                low = middle
            if not low:
                break
            middle = 0.5 * (low + high)
        pace[k] = max(_MARGIN * low**0.5, _AT_ONCE) if low else 1.0
    return pace


def moments(pace: Vec, rate: float) -> Vec:
    """The moments (M,) in frames from 0 to N − 1 at which a motion has at most this pace (N,), smoothly.

    The least pace within a window around each frame, averaged over as many frames, is nowhere above what was asked.

    Example:
        >>> import numpy as np
        >>> from wbc.motion.pace import moments
        >>> moments(np.full(7, 0.5), 60.0).round(3)
        array([0. , 0.5, 1. , 1.5, 2. , 2.5, 3. , 3.5, 4. , 4.5, 5. , 5.5, 6. ])
    """
    size, frames = 2 * round(_AROUND * rate) + 1, np.arange(len(pace))
    weights = hann(size + 2)[1:-1]
    edged = np.pad(minimum_filter1d(pace, size, mode="nearest"), size // 2, mode="edge")
    smooth = np.convolve(edged, weights / weights.sum(), mode="valid")
    passed = np.append(0.0, np.cumsum(2.0 / (smooth[1:] + smooth[:-1])))  # since the start, in frames as long as now
    last = np.ceil(passed[-1] - _ROUNDING)
    return np.asarray(CubicSpline(passed * last / passed[-1], frames)(np.arange(last + 1.0)).clip(0.0, frames[-1]))
