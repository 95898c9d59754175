"""``wbc compare``: recorded runs on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.console import one_sentence, place, reported, working
from wbc.cli.options import Out, RobotName, Show


@one_sentence
def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN...", help="Folders of runs; one is enough if its scenario saved others beside it."),
    ],
    *,
    names: Annotated[
        list[str] | None,
        typer.Option(
            "--name", help="What a run is called, once for each; default: as its scenario says, or its folder."
        ),
    ] = None,
    robot: RobotName = None,
    out: Out = None,
    show: Show = False,
) -> None:
    """Compare recorded runs on one page: curves over each other, ghosts of the robots, what differs."""
    from wbc.control.recorder import Run
    from wbc.errors import InvalidInput
    from wbc.models import load
    from wbc.report import save_comparison
    from wbc.report.build import require_extras
    from wbc.report.kept import kept_obstacles
    from wbc.report.record import CALLED, beside

    require_extras()
    folder = place(out, "compare")
    with working("drawing the runs") as step:
        model = None if robot is None else load(robot)
        loaded = [Run.load(run) for run in runs]
        called = [str(run.meta.get(CALLED) or "") for run in loaded]
        if len(loaded) == 1:
            others = beside(runs[0], loaded[0])
            loaded, called = [*loaded, *others.values()], [*called, *others]
        if names and len(names) != len(loaded):
            raise InvalidInput(f"{len(names)} names are given for {len(loaded)} runs; give --name once for each")
        if names or not all(called):
            called = names or _called(runs)
        if len(set(called)) < len(called):
            raise InvalidInput(f"two runs are called the same: {', '.join(called)}; give each a --name of its own")
        compared, obstacles = dict(zip(called, loaded, strict=True)), kept_obstacles(runs[0])
        page = save_comparison(compared, folder, robot=model, obstacles=obstacles, progress=step)
    reported(page, show=show)


def _called(runs: list[Path]) -> list[str]:
    """The shortest ends of the paths that tell the runs apart."""
    paths = [run.resolve() for run in runs]
    for depth in range(1, max(len(path.parts) for path in paths)):
        ends = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(ends)) == len(ends):
            return ends
    return [str(path) for path in paths]
