"""Block principal pivoting: how a working set that was wrong becomes the next one (Júdice and Pires, 1994)."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc.types import Index, Vec

_CHANCES = 3


@final
class Pivoting:
    """All wrong items are exchanged at once while their number falls, and three more times if it does not; after that
    one at a time, always the last, which cannot cycle."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """A new problem: nothing was tried."""
        self._fewest, self._chances = 1 << 30, _CHANCES

    def exchanged(
        self, items: Index, side: Vec, keep: Any, broken: Any, *, over: Vec, under: Vec
    ) -> tuple[Index, Vec] | None:  # fmt: skip
        """The next working set and its sides; None where nothing is wrong.

        Of ``items`` on ``side``, those of ``keep`` (mask) push the right way; ``broken`` (mask over all items) are
        beyond a bound by ``over`` or ``under``. The mask is changed.
        """
        broken[items] = False
        new = broken.nonzero()[0]
        kept = int(np.count_nonzero(keep))
        wrong = len(new) + len(items) - kept
        if wrong == 0:
            return None
        if wrong < self._fewest:
            self._fewest, self._chances = wrong, _CHANCES
        elif self._chances:
            self._chances -= 1
        else:
            last = max(new[-1] if len(new) else -1, items[~keep].max() if kept < len(items) else -1)
            keep, new = items != last, new[new == last]
        new_side = np.where(under[new] >= over[new], -1.0, 1.0)
        return np.concatenate([items[keep], new]), np.concatenate([side[keep], new_side])
