"""Lagrange: the dynamics of a planar chain in symbols, step by step. Importing this loads no sympy; ``derive`` does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wbc.models.chain import Chain

if TYPE_CHECKING:
    from wbc.models.lagrange.derivation import Derivation as Derivation


def derive(chain: Chain | str) -> Derivation:
    """The dynamics of a planar chain by Lagrange's equations, in symbols.

    Args:
        chain: a :class:`~wbc.models.chain.Chain`, or the word that spells it, such as "PRR".

    Raises:
        InvalidInput: a word that is no chain.

    Example:
        >>> from wbc.models.lagrange import derive
        >>> pr = derive("PR")
        >>> print(pr.M)
        Matrix([[m1 + m2, -d2*m2*sin(q2)], [-d2*m2*sin(q2), I2 + d2**2*m2]])
        >>> print(pr.coefficients.T)
        Matrix([[m1 + m2, I2 + d2**2*m2, d2*m2]])
    """
    from wbc.models.lagrange.derivation import derived

    return derived(chain if isinstance(chain, Chain) else Chain.parse(chain))
