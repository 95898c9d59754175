"""A moving picture of a recorded run, drawn without a screen: GIF, WebP or MP4."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.export.stage import Stage
from wbc.files import located, written
from wbc.models.model import RobotModel
from wbc.report import measure
from wbc.report.marks import RED, marks, strained
from wbc.report.motion import Motion, motion, quaternions
from wbc.report.replay import BUDGET
from wbc.report.shapes import VIEW, Part, check_kinds, obstacle_parts, parts, thinned, view
from wbc.sim.scenario import Progress, silent
from wbc.types import Index, Mat, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle

FORMATS = (".gif", ".webp", ".mp4")
#: What writes each format beside Pillow, which puts the words onto the pictures.
WRITERS = {".mp4": "imageio_ffmpeg"}
MOST_PIXELS = 4096
MOST_FRAMES = 20_000
TRAIL = 50  # so many frames of the way that a point went are drawn
SWATCH = 40  # a mark's colour is this part of the pictures that a palette is made of
INK, FAINT = (38, 45, 54), (92, 101, 112)


@final
class Camera(NamedTuple):
    """Where the camera looks, azimuth (90: along y) and elevation (−90: straight down) [deg], and from how far [m];
    without a distance so that everything is seen."""

    azimuth: float = float(np.degrees(np.arctan2(-VIEW[1], -VIEW[0])))
    elevation: float = -14.0
    distance: float | None = None

    @classmethod
    def before(cls, robot: RobotModel) -> Camera:
        """The camera that a robot is seen by at first: from above where it moves in a plane."""
        x, y, z = view(robot)
        azimuth = float(np.degrees(np.arctan2(-y, -x)))
        return cls() if (x, y, z) == VIEW else cls(azimuth, -float(np.degrees(np.arctan2(z, np.hypot(x, y)))))


def movie(
    run: Run,
    robot: RobotModel,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (640, 480),
    fps: float = 25.0,
    start: float = 0.0,
    end: float | None = None,
    speed: float = 1.0,
    camera: Camera | None = None,
    obstacles: Sequence[Obstacle] = (),
    progress: Progress = silent,
) -> Path:
    """Write the run of ``robot`` from ``start`` to ``end`` [s] as a moving picture, ``speed`` times as fast as it was.

    The end of ``path`` says the format: .gif, .webp or .mp4. ``size`` is width and height in pixels. Contact forces,
    pushes, targets, centre of mass and support polygon are those of the report; a robot that travels is followed.
    ``obstacles`` are drawn with it. A picture shows the tick nearest to its time.

    Raises:
        InvalidInput: another format, a size, rate or time out of range, a robot that cannot be drawn, or a place that
            cannot be written.
        NotSupported: a package is missing, or OpenGL; the message says what to install.
    """
    check_kinds(run, checks.instance("robot", robot, RobotModel, "a robot from wbc.load(...)"))
    target = located(path)
    kind = target.suffix.lower()
    if kind not in FORMATS:
        raise InvalidInput(
            f"{target.name} is no {', '.join(FORMATS)}: the end of the name says which format is written"
        )
    checks.packages(kind, *{"PIL", WRITERS.get(kind, "PIL")}, extra="export,video")
    pair = checks.pair("size", size, "width, height")
    width, height = (int(checks.number("size", pixels, low=16, high=MOST_PIXELS)) // 2 * 2 for pixels in pair)
    looks = Camera.before(robot) if camera is None else _sound(camera)
    rows = _rows(run, fps, start, end, speed)
    solid = thinned(parts(robot), BUDGET)
    if not solid:
        raise InvalidInput(f"{robot.name} has no shape to draw")
    solid += obstacle_parts(obstacles)
    moving = motion(run, robot, rows, sorted({part.link for part in solid}), obstacles)
    with written(target) as aside:
        pictures = _Pictures(run, robot, moving, solid, size=(width, height), camera=looks, speed=speed)
        try:
            frames = pictures.all(progress)
            if kind == ".mp4":
                _mp4(frames, aside, (width, height), fps)
            else:
                _with_pillow(frames, aside, fps, len(rows), pictures.palette() if kind == ".gif" else None)
        finally:
            pictures.stage.close()
    return target


def _sound(camera: Camera) -> Camera:
    azimuth, elevation, distance = checks.instance("camera", camera, Camera, "a wbc.export.Camera")
    checks.number("azimuth of the camera", azimuth)
    checks.number("elevation of the camera", elevation)
    if distance is not None:
        checks.number("distance of the camera", distance, low=0.0, strict=True)
    return camera


@final
class _Pictures:
    """The pictures of a motion, with a legend and the time."""

    def __init__(
        self, run: Run, robot: RobotModel, moving: Motion, solid: list[Part], *, size: tuple[int, int], camera: Camera,
        speed: float,
    ) -> None:  # fmt: skip
        from PIL import ImageFont

        self._moving, self._speed, self._size = moving, speed, size
        self._poses = {
            link: np.column_stack([position, quaternions(rotation)])
            for link, (position, rotation) in moving.links.items()
        }
        self._marks = [mark for mark in marks(moving, robot) if not mark.hidden]
        self._strained, self._start = strained(run, robot), float(measure.clock(run)[0])
        self._at, extent = _middles(moving, solid)
        far = camera.distance or 1.45 * extent * max(1.0, size[1] / size[0])
        angles = np.array([camera.azimuth, camera.elevation, far])
        self.stage = Stage(solid, size=size, camera=angles, extent=extent)
        self._font: Any = ImageFont.load_default(size=max(11, round(size[1] / 34)))

    def all(self, progress: Progress) -> Iterator[Any]:
        """Every picture as a Pillow image."""
        count = len(self._moving.times)
        for i in range(count):
            progress(i / count, "drawing the motion")
            yield self._picture(i)
        progress(1.0, "drawing the motion")

    def palette(self) -> Any:
        """The 256 colours of a few pictures, those of a push among them: for a format that has no more."""
        from PIL import Image, ImageColor

        pushes = np.linalg.norm(self._moving.pushes[:, 1] - self._moving.pushes[:, 0], axis=1)
        some = {0, len(pushes) // 2, len(pushes) - 1, int(pushes.argmax())}
        sheet = np.vstack([np.asarray(self._picture(i)) for i in sorted(some)])
        for mark in self._marks:  # marks are few pixels: their colours would be left out
            swatch = np.full((sheet.shape[0] // SWATCH, *sheet.shape[1:]), ImageColor.getrgb(mark.color), np.uint8)
            sheet = np.vstack([sheet, swatch])
        return Image.fromarray(sheet).quantize(256, method=Image.Quantize.MEDIANCUT)

    def _picture(self, i: int) -> Any:
        from PIL import Image

        t = float(self._moving.times[i]) - self._start
        now = [(mark, mark.points[max(0, i - TRAIL) : i + 1, 0] if mark.kind == "point" else mark.points[i])
               for mark in self._marks]  # fmt: skip
        red = [link for link, spans in self._strained.items() if any(a <= t <= b for a, b in spans)]
        poses = {link: pose[i] for link, pose in self._poses.items()}
        picture = Image.fromarray(self.stage.draw(poses, now, at=self._at[i], red=red))
        self._write_on(picture, t)
        return picture

    def _write_on(self, picture: Any, t: float) -> None:
        from PIL import ImageDraw

        draw, font = ImageDraw.Draw(picture), self._font
        line = round(1.45 * font.size)
        named = {mark.name: mark.color for mark in self._marks} | ({"joint at a limit": RED} if self._strained else {})
        for k, (name, color) in enumerate(named.items()):
            x, y, r = 0.9 * line, (k + 1.0) * line, 0.22 * line
            draw.ellipse((x - r, y - r, x + r, y + r), fill=color)
            draw.text((x + 2.2 * r, y), name, fill=FAINT, font=font, anchor="lm")
        clock = f"{t:.2f} s" + ("" if self._speed == 1.0 else f", {self._speed:g} times as fast")
        draw.text((0.7 * line, self._size[1] - 0.6 * line), clock, fill=INK, font=font, anchor="ls")


def _rows(run: Run, fps: float, start: float, end: float | None, speed: float) -> Index:
    """The row of every picture."""
    if not run.rows:
        raise InvalidInput("the run has no ticks")
    times, whole = measure.times(run), measure.seconds(run)
    checks.number("fps", fps, low=0.0, high=240.0, strict=True)
    checks.number("speed", speed, low=0.0, strict=True)
    first = checks.number("from", start, low=0.0, high=whole)
    last = min(checks.number("to", whole if end is None else end, low=first, strict=True), float(times[-1]))
    count = int(max(last - first, 0.0) * fps / speed + 1e-9) + 1
    if count > MOST_FRAMES:
        raise InvalidInput(f"{count} pictures are too many; at most {MOST_FRAMES}: another fps, speed, from or to")
    wanted = first + speed / fps * np.arange(count)
    after = np.clip(np.searchsorted(times, wanted), 1, max(run.rows - 1, 1))
    nearer = np.abs(times[np.minimum(after, run.rows - 1)] - wanted) < np.abs(times[after - 1] - wanted)
    return np.asarray(np.where(nearer, after, after - 1))


def _middles(moving: Motion, solid: list[Part]) -> tuple[Mat, float]:
    """Where the camera looks in every picture (k, 3), and how large the robot is with its way [m]."""
    low, high = np.full((len(moving.times), 3), np.inf), np.full((len(moving.times), 3), -np.inf)
    for part in solid:
        position, rotation = moving.links[part.link]
        ends = np.array([part.vertices.min(axis=0), part.vertices.max(axis=0)])
        corners = np.array([[ends[a, 0], ends[b, 1], ends[c, 2]] for a in (0, 1) for b in (0, 1) for c in (0, 1)])
        placed = np.einsum("kij,mj->kmi", rotation, corners) + position[:, None]
        low, high = np.minimum(low, placed.min(axis=1)), np.maximum(high, placed.max(axis=1))
    middles = 0.5 * (low + high)
    extent = float(np.linalg.norm(high - low, axis=1).max())
    if np.linalg.norm(np.ptp(middles, axis=0)) < extent:  # it stays where it is: so does the camera
        whole: Vec = 0.5 * (low.min(axis=0) + high.max(axis=0))
        return np.tile(whole, (len(middles), 1)), float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    window = min(TRAIL // 2, len(middles) - 1)
    padded = np.pad(middles, ((window, window), (0, 0)), mode="edge")
    mean = np.ones(2 * window + 1) / (2 * window + 1)
    return np.column_stack([np.convolve(padded[:, k], mean, mode="valid") for k in range(3)]), extent


def _with_pillow(frames: Iterator[Any], path: Path, fps: float, count: int, palette: Any) -> None:
    """GIF, whose times are hundredths of a second and whose colours are those of ``palette``, or WebP."""
    from PIL import Image

    unit = 10 if palette is not None else 1  # [ms]
    ends = np.rint(np.arange(count + 1) * 1000.0 / fps / unit).astype(int) * unit
    durations = [int(d) for d in np.maximum(np.diff(ends), unit)]
    if palette is None:
        first = next(frames)
        first.save(
            path,
            save_all=True,
            append_images=frames,
            duration=durations,
            loop=0,
            quality=82,
            method=3,
            minimize_size=False,
        )
        return
    plain = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    first = next(plain)
    first.save(path, save_all=True, append_images=plain, duration=durations, loop=0, optimize=False, disposal=1)


def _mp4(frames: Iterator[Any], path: Path, size: tuple[int, int], fps: float) -> None:
    """H.264, as every browser and every slide shows it."""
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(str(path), size, fps=fps, macro_block_size=2, quality=7)
    writer.send(None)
    try:
        for frame in frames:
            writer.send(np.ascontiguousarray(frame).tobytes())
    finally:
        writer.close()
