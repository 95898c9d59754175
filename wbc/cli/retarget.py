"""``wbc retarget``: the motion of a person as a motion of a robot, with a verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.console import NO, one_sentence, place, reported, say, table, working
from wbc.cli.options import Out, Show


@one_sentence
def retarget(
    motion: Annotated[
        str, typer.Argument(help="A .bvh, .npz or .csv file, or one of our own: squat, reach, turn, dance, walk.")
    ],
    *,
    robot: Annotated[str, typer.Option(help="A name, or a URDF or MJCF file.")] = "humanoid",
    mapping: Annotated[Path | None, typer.Option(help="A TOML file: which frame follows which part.")] = None,
    repair: Annotated[bool, typer.Option("--repair", help="Look for the nearest motion that is possible.")] = False,
    out: Out = None,
    show: Show = False,
) -> None:
    """Retarget a motion to a robot and judge every frame. Exit code 0: all are certified, 1: some are not."""
    from wbc.models import load
    from wbc.motion import Motion, made, retarget
    from wbc.motion.witness import UNITS
    from wbc.report.build import require_extras

    require_extras()

    with working("retargeting") as step:
        clip = Motion.read(motion) if Path(motion).suffix else made(motion)
        model = load(robot, base="floating")
        folder = place(out, f"retarget-{clip.name}")
        done = retarget(clip, model, mapping, repair=repair, progress=step)
        page = done.report(folder)
    made_table = table("", "impossible", "frames", "worst", "unit", "part", "at s")
    for kind, (frames, k, amount, part) in done.faults().items():
        made_table.add_row(kind, str(frames), f"{amount:.3g}", UNITS[kind], part, f"{k / done.rate:.2f}")
    before = ""
    if done.before is not None:
        before = f", {100 * done.before.certified:.1f} % before repair, which adds {done.added:.2f} s"
    said = f"{100 * done.certified:.1f} % of {len(done.q)} frames of {clip.name} certified for {model.name}{before}"
    say(said, *([made_table] if done.faults() else []))
    reported(page, show=show)
    raise typer.Exit(0 if done.certified == 1.0 else NO)
