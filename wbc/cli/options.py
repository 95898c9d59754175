"""Options that several verbs have, each said once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

SolverName = Annotated[str, typer.Option("--solver", help="QP solver.")]
RobotName = Annotated[
    str | None,
    typer.Option("--robot", help="A name, or a URDF or MJCF file: who is drawn, where the run's name is no help."),
]
PlantName = Annotated[
    str | None,
    typer.Option(
        "--plant",
        help="What the commands act on: integrator or mujoco, as far as the scenario has them; default: its first.",
    ),
]
SetOptions = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter, as wbc list shows them.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the rows there.")]
Out = Annotated[Path | None, typer.Option("--out", help="Folder of the report; default runs/NAME-TIME.")]
Show = Annotated[bool, typer.Option("--open", help="Open the report in a browser.")]
