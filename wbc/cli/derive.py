"""``wbc derive``: the dynamics of a planar chain in symbols, step by step."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from wbc.cli.console import one_sentence

#: Chains that have a name of their own.
NAMES = {"pr": "PR", "4p": "PxPyPxPy"}


@one_sentence
def derive(
    chain: Annotated[
        str, typer.Argument(help="pr, 4p, or a word of R (revolute), Px and Py (prismatic; P is Px): PRR, RPyR.")
    ],
    latex: Annotated[bool, typer.Option("--latex", help="A LaTeX document instead of text.")] = False,
) -> None:
    """Derive the dynamics of a planar chain: energies, M, c, g, J, regressor, Cartesian inertia, momentum."""
    from wbc.models.chain import Chain
    from wbc.models.lagrange import derive as derived

    derivation = derived(Chain.parse(NAMES.get(chain.lower(), chain)))
    if latex:
        typer.echo(derivation.latex(), nl=False)
        return
    console = Console(highlight=False)
    for line in derivation.text(console.width).splitlines():
        style = "bold" if line[:1].isdigit() else ""
        console.print(Text(line, style=style), soft_wrap=True)
