"""Tolerances that more than one file uses: for rounding, for equal numbers, for constraints that are met.

Shares are of the size that the place of use names: of the largest number in a sum, of the length of a row. In double
precision a number is known to a share of 1.1e-16. A tolerance with a reason of its own stands where it is used.
"""

from __future__ import annotations

from typing import Final

#: A divisor is at least this, where a size may be zero.
TINY: Final = 1e-300
#: A sum of a few terms is off by no more than this share of them.
NOISE: Final = 1e-14
#: A result below this share of what it is computed from is rounding: it has no sign, and a pivot or a singular value as
#: small counts as zero. It is 1e4 times what a number is off by, as matrices here are conditioned up to that.
ROUNDING: Final = 1e-12
#: A sum of many terms, among them results of other sums, that is below this share of what it is made of is zero.
CANCELS: Final = 1e-11
#: Numbers that differ by a smaller share of their size are the same, and the index decides between them, so that every
#: processor decides alike.
SAME: Final = 1e-9
#: The default accuracy of other solvers, in their own measures.
ACCURACY: Final = 1e-9
#: An answer this near to the optimum, as a share of it, is as good as exact: the root of what a number is off by.
SHARP: Final = 1e-8
#: Numbers [m, rad, m/s or rad/s] beyond which no state and no pose can be: their own rounding would be felt.
HUGE: Final = 1.0 / SHARP
#: Squares of smaller numbers do not overflow, nor do sums of these.
MODERATE: Final = 1e100
#: An answer is within this share of where it would be without rounding, and at a bound that is no farther away.
NEAR: Final = 1e-7
#: A limit is met that is exceeded by no more than this, in the limit's own unit (1e-6 N m, 1 µrad, 1 µm/s).
MET: Final = 1e-6
#: An answer certified at a tolerance is within this many times that of the optimum, relative to the target's size.
DISTANCE: Final = 100.0
