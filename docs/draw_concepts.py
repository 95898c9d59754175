"""Draw the figures of the concept pages: ``python docs/draw_concepts.py``. Each has a background, light or dark."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "figures"
STYLE = """
text { font: 15px system-ui, "DejaVu Sans", sans-serif; fill: var(--ink); }
.small { font-size: 13px; fill: var(--soft); }
.title { font-weight: 600; }
.card { fill: var(--card); }
.box { fill: var(--box); stroke: var(--line); stroke-width: 1.3; }
.line { fill: none; stroke: var(--line); stroke-width: 1.6; }
.first { fill: none; stroke: var(--first); stroke-width: 2.6; }
.second { fill: none; stroke: var(--second); stroke-width: 2.6; }
.ink-first { fill: var(--first); } .ink-second { fill: var(--second); }
.tint-first { fill: var(--first); fill-opacity: 0.18; stroke: var(--first); stroke-width: 1.3; }
.tint-second { fill: var(--second); fill-opacity: 0.18; stroke: var(--second); stroke-width: 1.3; }
svg { --ink: #1d2329; --soft: #565f6a; --card: #f6f7f9; --box: #ffffff; --line: #8a94a0;
  --first: #1f6fd0; --second: #c2571a; }
@media (prefers-color-scheme: dark) {
  svg { --ink: #e8ebef; --soft: #aab2bc; --card: #1b1f24; --box: #262b32; --line: #7d8792;
    --first: #6aaefc; --second: #f0955a; }
}
"""


class Drawing:
    """An SVG of 720 units' width, filled by calls."""

    def __init__(self, height: int, about: str) -> None:
        heads = "".join(
            f'<marker id="{kind}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="9" markerHeight="9" '
            f'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0L8 4L0 8z" fill="var(--{kind})"/></marker>'
            for kind in ("line", "first", "second")
        )
        self.parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 {height}" role="img" aria-label="{about}">',
            f"<style>{STYLE}</style><defs>{heads}</defs>",
            f'<rect class="card" width="720" height="{height}" rx="10"/>',
        ]

    def text(self, x: float, y: float, text: str, kind: str = "", at: str = "middle") -> None:
        self.parts.append(f'<text x="{x}" y="{y}" class="{kind}" text-anchor="{at}">{text}</text>')

    def box(self, x: float, y: float, width: float, height: float, *lines: str, kind: str = "box") -> None:
        """A box; its first line is a title, the others are small."""
        self.parts.append(f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" class="{kind}"/>')
        top = y + height / 2 + 5 - 9 * (len(lines) - 1)
        for i, line in enumerate(lines):
            self.text(x + width / 2, top + 18 * i, line, "title" if i == 0 else "small")

    def arrow(self, x1: float, y1: float, x2: float, y2: float, kind: str = "line") -> None:
        self.parts.append(f'<path d="M{x1} {y1}L{x2} {y2}" class="{kind}" marker-end="url(#{kind})"/>')

    def path(self, d: str, kind: str = "line") -> None:
        self.parts.append(f'<path d="{d}" class="{kind}"/>')

    def dot(self, x: float, y: float, kind: str = "ink-first", radius: float = 5) -> None:
        self.parts.append(f'<circle cx="{x}" cy="{y}" r="{radius}" class="{kind}"/>')

    def save(self, name: str) -> None:
        (FOLDER / f"{name}.svg").write_text("\n".join([*self.parts, "</svg>\n"]), encoding="utf-8")


def robot() -> None:
    """The entries of q, v and tau of a robot with a free base."""
    d = Drawing(222, "The entries of q, v and tau of a robot with a floating base")
    rows = (
        (
            "q",
            50,
            (
                (150, "x y z [m]", "first"),
                (190, "quaternion x y z w", "first"),
                (250, "joint positions [rad, m]", "second"),
            ),
        ),
        (
            "v",
            110,
            ((150, "linear [m/s]", "first"), (190, "angular [rad/s]", "first"), (250, "joint velocities", "second")),
        ),
        ("τ", 170, ((340, "", ""), (250, "joint torques [N m, N]", "second"))),
    )
    d.text(240, 32, "base", "title")
    d.text(535, 32, "joints (nj)", "title")
    for name, y, cells in rows:
        d.text(40, y + 24, name, "title")
        x = 70
        for width, label, kind in cells:
            if label:
                d.parts.append(f'<rect x="{x}" y="{y}" width="{width}" height="36" rx="4" class="tint-{kind}"/>')
                d.text(x + width / 2, y + 23, label)
            else:
                d.text(x + width / 2, y + 23, "no motor drives the base", "small")
            x += width
    d.save("concept-robot")


def stack() -> None:
    """From members to a command."""
    d = Drawing(250, "The members of a stack are compiled to one quadratic program, which each tick solves")
    members = (
        ("tasks", "minimise their error"),
        ("contacts", "bear forces"),
        ("constraints", "always hold"),
        ("components", "remember"),
    )
    for i, (name, does) in enumerate(members):
        d.box(20, 20 + 54 * i, 190, 44, name, does)
        d.path(f"M210 {42 + 54 * i}H240V125")
    d.arrow(240, 125, 268, 125)
    d.box(270, 80, 130, 90, "plan", "compiled once,", "for one level")
    d.arrow(400, 125, 438, 125)
    d.box(440, 80, 110, 90, "QP", "filled, solved", "in each tick")
    d.arrow(550, 125, 588, 125)
    d.box(590, 80, 112, 90, "command", "τ, a, v, q, f", "certificate")
    d.text(495, 215, "state (t, q, v)", "small")
    d.arrow(495, 198, 495, 172)
    d.save("concept-stack")


def level() -> None:
    """What each formulation level decides."""
    d = Drawing(226, "The unknowns and task rows of the three formulation levels")
    columns = (
        ("VelocityLevel", "v", "J v = ẏ_ref + rate · e", "v, q"),
        ("AccelerationLevel", "a", "J a = ÿ_ref + kd ė + kp e − J̇ v", "a, v, q"),
        ("InverseDynamics", "a, f and so τ", "the same; M a + h = Sᵀ τ + Jᵀ f", "τ, f, a, v, q"),
    )
    for i, (name, unknown, rows, gives) in enumerate(columns):
        x = 20 + 232 * i
        d.box(x, 20, 216, 40, name, kind="tint-first")
        d.text(x + 108, 88, "it decides", "small")
        d.text(x + 108, 108, unknown, "title")
        d.text(x + 108, 136, "rows of a task", "small")
        d.text(x + 108, 156, rows, "small" if len(rows) > 26 else "")
        d.text(x + 108, 184, "the command has", "small")
        d.text(x + 108, 204, gives, "title")
    d.save("concept-level")


def hierarchies() -> None:
    """A velocity beyond a limit, under least squares and under scaling; two tasks in conflict."""
    d = Drawing(292, "Weighted, strict and scaled solutions of two tasks that conflict, and of one task beyond a limit")
    d.text(175, 30, "Two tasks conflict", "title")
    d.path("M60 85H290")
    for x, name in ((80, "target of task 1"), (270, "target of task 2")):
        d.path(f"M{x} 78V92")
        d.text(x, 68, name, "small")
    solutions = ((125, 118, "Weighted: a compromise by weights", "second"), (80, 168, "Strict: task 1 first", "first"))
    for x, y, name, kind in solutions:
        d.path(f"M60 {y + 12}H290")
        d.dot(x, y + 12, f"ink-{kind}")
        d.text(175, y + 36, name, "small")
    d.text(175, 256, "The dot is the solution.", "small")
    d.text(540, 30, "One task beyond a limit", "title")
    d.parts.append('<rect x="400" y="130" width="190" height="120" class="box"/>')
    d.text(495, 270, "what the limits allow", "small")
    d.path("M400 250L647 68", "line")
    d.dot(647, 68, "ink-second", 4)
    d.text(634, 56, "desired", "small")
    d.arrow(400, 250, 588, 131, "second")
    d.arrow(400, 250, 560, 132, "first")
    d.text(600, 126, "least squares", "small", "start")
    d.text(550, 118, "Scaled", "small", "end")
    d.save("concept-hierarchies")


def contacts() -> None:
    """A friction cone, and the schedule of two feet."""
    d = Drawing(236, "The friction cone of a contact, and a schedule of two feet")
    d.text(150, 30, "Force of a contact", "title")
    d.path("M150 180L80 70H220Z", "tint-first")
    d.arrow(150, 180, 175, 82, "first")
    d.path("M40 180H260")
    d.path("M110 180h80v12h-80z", "tint-second")
    d.text(236, 84, "|f_t| ≤ µ f_z", "small", "start")
    d.text(184, 116, "f", "title", "start")
    d.text(150, 216, "f is an unknown of the QP", "small")
    d.text(520, 30, "Schedule", "title")
    for y, name, spans in ((70, "left", ((0, 300),)), (120, "right", ((0, 110), (200, 100)))):
        d.text(372, y + 19, name, "", "end")
        for x, width in spans:
            d.parts.append(f'<rect x="{385 + x}" y="{y}" width="{width}" height="28" rx="4" class="tint-first"/>')
    d.text(540, 139, "open", "small")
    for x in (495, 585):
        d.path(f"M{x} 58V162")
    d.arrow(385, 172, 688, 172)
    for x, name in ((440, "plan 1"), (540, "plan 2"), (636, "plan 1")):
        d.text(x, 194, name, "small")
    d.text(535, 216, "each set has its own compiled plan", "small")
    d.save("concept-contacts")


def certificate() -> None:
    """A solver's point, checked against the data of the problem."""
    d = Drawing(200, "The certificate is computed from the data of the problem and the point of the solver")
    d.box(20, 62, 120, 70, "QP", "rows, cost,", "units")
    d.arrow(140, 97, 178, 97)
    d.box(180, 62, 130, 70, "any solver", "x, multipliers")
    d.arrow(310, 97, 348, 97)
    d.box(
        350,
        40,
        180,
        114,
        "certificate",
        "rows violated by …",
        "gradient left: …",
        "duality gap: …",
        "task off by …",
        kind="tint-first",
    )
    d.path("M80 62V22H440V38")
    d.text(260, 16, "the problem's own data", "small")
    d.arrow(530, 75, 578, 62)
    d.arrow(530, 120, 578, 136)
    d.box(580, 40, 122, 40, "SOLVED")
    d.box(580, 116, 122, 40, "not ok", kind="tint-second")
    d.text(360, 184, "The status of the solver itself is not used.", "small")
    d.save("concept-certificate")


def fallback() -> None:
    """The fallback sequence."""
    d = Drawing(206, "The fallback sequence of a tick, from the certified solution to damping")
    names = (
        ("solved", "certified"),
        ("other solver", "certified"),
        ("relaxed", "limits violated", "as little as possible"),
        ("closed form", "equalities only"),
        ("hold", "last command"),
        ("damped", "brake to rest"),
    )
    for i, lines in enumerate(names):
        x, y = 20 + 236 * (i % 3), 24 + 92 * (i // 3)
        d.box(x, y, 208, 66, *lines, kind="tint-first" if i < 2 else "box" if i < 3 else "tint-second")
        if i % 3 < 2:
            d.arrow(x + 208, y + 33, x + 234, y + 33)
    d.path("M596 90V103H124V114")
    d.text(360, 198, "In one tick: the first that succeeds makes the command.", "small")
    d.save("concept-fallback")


if __name__ == "__main__":
    for draw in (robot, stack, level, hierarchies, contacts, certificate, fallback):
        draw()
