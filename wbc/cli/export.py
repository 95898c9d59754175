"""``wbc export``: a recorded run as a moving picture, or as a log for Foxglove, PlotJuggler and Rerun."""

from __future__ import annotations

import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.console import notes, one_sentence, progress, say
from wbc.cli.options import RobotName


@one_sentence
def export(
    folder: Annotated[Path, typer.Argument(help="Where run.npz and meta.json are.")],
    *,
    gif: Annotated[Path | None, typer.Option(metavar="FILE", help="Moving picture that plays everywhere.")] = None,
    webp: Annotated[Path | None, typer.Option(metavar="FILE", help="Moving picture of half the size.")] = None,
    mp4: Annotated[Path | None, typer.Option(metavar="FILE", help="Video, the smallest; extra `video`.")] = None,
    mcap: Annotated[Path | None, typer.Option(metavar="FILE", help="Log for Foxglove and PlotJuggler.")] = None,
    rerun: Annotated[Path | None, typer.Option(metavar="FILE", help="Recording for Rerun; extra `rerun`.")] = None,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Of pictures, in pixels.")] = "640x480",
    fps: Annotated[float, typer.Option(help="Pictures in a second.")] = 25.0,
    start: Annotated[float, typer.Option("--from", help="Time of the run at the first picture in seconds.")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", help="Time of the run at the last one.")] = None,
    speed: Annotated[float, typer.Option(help="0.5: half as fast as it was.")] = 1.0,
    camera: Annotated[
        str | None,
        typer.Option(metavar="AZIMUTH,ELEVATION[,DISTANCE]", help="Where it looks in degrees, from how far in metres."),
    ] = None,
    robot: RobotName = None,
) -> None:
    """A recorded run for others: a moving picture drawn without a screen, or a log for other programs."""
    from wbc import checks
    from wbc.control.recorder import Run
    from wbc.errors import InvalidInput
    from wbc.export import Camera, movie, to_mcap, to_rerun
    from wbc.files import written
    from wbc.models import load
    from wbc.report.kept import kept_obstacles
    from wbc.report.record import fits, named

    pictures = {".gif": gif, ".webp": webp, ".mp4": mp4}
    wanted = [path for path in (*pictures.values(), mcap, rerun) if path is not None]
    if not wanted:
        raise InvalidInput("say what to write: --gif, --webp, --mp4, --mcap or --rerun, each with a file")
    for ending, path in pictures.items():
        if path is not None and path.suffix.lower() != ending:
            raise InvalidInput(f"--{ending[1:]} {path}: the name must end in {ending}")
    sides = size.split("x")
    if len(sides) != 2 or not all(side.isdecimal() for side in sides):
        raise InvalidInput(f"--size {size}: give width and height in pixels: 640x480")
    pixels = int(sides[0]), int(sides[1])
    looks = None
    if camera is not None:
        numbers = [checks.typed("camera", part) for part in camera.split(",")]
        if len(numbers) not in (2, 3):
            raise InvalidInput(f"--camera {camera}: give azimuth and elevation, and perhaps a distance: 140,-15,3")
        looks = Camera(*numbers)
    run = Run.load(folder)
    with notes(), ExitStack() as files:  # all of the files are written, or none
        model = named(run) if robot is None else load(robot)
        if model is not None and not fits(model, run):
            raise InvalidInput(f"{model.name} has other joints or another base than the run's robot")
        if model is None and any(pictures.values()):
            raise InvalidInput("the run's robot cannot be loaded by its name; give --robot")
        asides = {path: files.enter_context(written(path)) for path in wanted}
        for path in pictures.values():
            if path is not None and model is not None:
                with progress(f"exporting {path.name}") as step:
                    movie(
                        run, model, asides[path], size=pixels, fps=fps, start=start, end=end, speed=speed,
                        camera=looks, obstacles=kept_obstacles(folder), progress=step,
                    )  # fmt: skip
        for path, write in ((mcap, to_mcap), (rerun, to_rerun)):
            if path is not None:
                with progress(f"exporting {path.name}") as step:
                    write(run, asides[path], robot=model, progress=step)
        if model is None:
            warnings.warn("the robot is not drawn: it cannot be loaded by the run's name; give --robot", stacklevel=1)
    say(*(f"{path}: {path.stat().st_size / 1e6:.2f} MB" for path in wanted))
