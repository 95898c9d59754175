"""``wbc retarget``: the motion of a person as a motion of a robot, with a verdict."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.console import NO, notes, one_sentence, progress, say, table, tell


@one_sentence
def retarget(
    motion: Annotated[
        str, typer.Argument(help="A .bvh, .npz or .csv file, or one of our own: squat, reach, turn, dance, walk.")
    ],
    *,
    robot: Annotated[str, typer.Option(help="A name, or a URDF or MJCF file.")] = "humanoid",
    mapping: Annotated[Path | None, typer.Option(help="A TOML file: which frame follows which part.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; default runs/retarget-MOTION-TIME.")] = None,
) -> None:
    """Retarget a motion to a robot and judge every frame. Exit code 0: all are certified, 1: some are not."""
    from wbc.files import made_folder
    from wbc.models import load
    from wbc.motion import Motion, made, retarget
    from wbc.motion.made import MOTIONS

    with notes() as found, progress("retargeting") as step:
        clip = made(motion) if motion in MOTIONS else Motion.read(motion)
        model = load(robot, base="floating")
        folder = made_folder(out or Path("runs") / f"retarget-{clip.name}-{datetime.now():%Y%m%d-%H%M%S}")
        done = retarget(clip, model, mapping, progress=step)
        done.save(folder / "motion.npz")
        done.to_csv(folder / "motion.csv")
    tell(found)
    made_table = table("", "impossible", "frames", "worst", "unit", "part", "at s")
    from wbc.motion.verdict import UNITS

    for kind, (frames, k, amount, part) in done.faults().items():
        made_table.add_row(kind, str(frames), f"{amount:.3g}", UNITS[kind], part, f"{k / done.rate:.2f}")
    say(f"{100 * done.certified:.1f} % of {len(done.q)} frames of {clip.name} certified for {model.name}", made_table)
    say(f"motion: {folder / 'motion.npz'}")
    raise typer.Exit(0 if done.certified == 1.0 else NO)
