"""From an MJCF file to a :class:`~wbc.models.urdf.Urdf`: compiled by MuJoCo, then written as links and joints.

Defaults, angles, Euler conventions and masses from shapes are the compiler's; what follows is the description alone, so
that a robot from MJCF is the same kind of thing as one from URDF, in the model and in physics.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, cast, final
from weakref import finalize
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from wbc.errors import ModelError
from wbc.models.folders import Folders
from wbc.models.geometry import IDENTITY, Box, Color, Cylinder, Geometry, Mesh, Origin, Shape, Sphere, capsule, triple
from wbc.models.mjcf_source import MjcfSource
from wbc.models.mujoco_import import import_mujoco
from wbc.models.poses import BASE
from wbc.models.urdf import Inertial, Joint, JointKind, Link, Loop, Urdf, gathered, six, unused
from wbc.types import Mat, Vec

WORLD = "world"
#: The colour of a geom that has none of its own, as float32.
_GREY = np.array([0.5, 0.5, 0.5, 1.0])
#: Gravity that differs by less from 9.81 m/s² is that of another place on Earth, or rounded.
_GRAVITY = 0.1
#: Geometry groups that viewers draw unless told otherwise.
_DRAWN = 3


def read_mjcf(root: Element, path: Path, *, packages: Iterable[str | Path] = ()) -> Urdf:
    """The robot of an MJCF file whose root element is ``root``.

    Raises:
        ModelError: MuJoCo is not installed or refuses the file, or it has what a tree of hinges and slides has not;
            named.
        PathRefused: a mesh, or a file that is included, outside the folders.
    """
    folders = Folders.around(path.parent, packages)
    name = root.get("model", path.stem)
    source = MjcfSource(root, path, folders)
    try:
        mj = import_mujoco()
    except ImportError as cause:
        raise ModelError(
            f"MJCF is compiled by MuJoCo, which cannot be imported ({cause}); pip install mujoco"
        ) from None
    try:
        compiled = mj.MjModel.from_xml_string(source.text)
    except ValueError as cause:
        raise ModelError(_with_file(" ".join(str(cause).split()), source.meshes)) from None
    return replace(
        _Translation(mj, compiled, folders, source.meshes).robot(name, source.left_out),
        path=path.resolve(),
        missing_meshes=tuple(source.missing),
    )


def read_compiled(model: Any) -> Urdf:
    """The robot of a ``mujoco.MjModel`` or ``MjSpec``. Its meshes are written to files, which live as long as it does.

    Raises:
        ModelError: as :func:`read_mjcf`.
    """
    mj = import_mujoco()
    try:
        compiled = model.copy().compile() if isinstance(model, mj.MjSpec) else model
    except ValueError as cause:
        raise ModelError(" ".join(str(cause).split())) from None
    folder = Path(mkdtemp(prefix="wbc-meshes-"))
    folders = Folders(folder)
    finalize(folders, rmtree, folder, ignore_errors=True)
    name = bytes(compiled.names).split(b"\0")[0].decode(errors="replace")
    return _Translation(mj, compiled, folders, None).robot(name or "robot", [])


def _with_file(sentence: str, meshes: Mapping[str, Path]) -> str:
    """What MuJoCo says of a mesh by its name, with its file."""
    named = [str(path) for name, path in meshes.items() if f"Element name '{name}'" in sentence]
    return sentence if not named or named[0] in sentence else f"{sentence}: {named[0]}"


@final
class _Translation:
    """One compiled model, body by body."""

    def __init__(self, mj: Any, compiled: Any, folders: Folders, meshes: Mapping[str, Path] | None) -> None:
        self.mj, self.m, self.folders, self.meshes = mj, compiled, folders, meshes
        self.links: list[Link] = []
        self.joints: list[Joint] = []
        self.loops: list[Loop] = []
        self.left_out: list[str] = []
        self.mimics: dict[int, tuple[str, float, float]] = {}
        # Names of the file; what gets one here is called otherwise. Bodies and sites may share a name, links may not.
        self._joint_names = {str(compiled.jnt(i).name) for i in range(compiled.njnt)}
        self._body_names = {WORLD, *(str(compiled.body(i).name) for i in range(compiled.nbody))}
        self._link_names = self._body_names | {str(compiled.site(i).name) for i in range(compiled.nsite)}

    def robot(self, name: str, left_out: Sequence[str]) -> Urdf:
        m = self.m
        self.left_out += left_out
        self._refuse_and_leave_out()
        for equality in np.flatnonzero(m.eq_active0):
            if m.eq_type[equality] == self.mj.mjtEq.mjEQ_JOINT:
                self._add_mimic(int(equality))
        roots = self._without_things(self._roots())
        free = [body for body in roots if self._is_free(body)]
        if free and len(roots) > 1:
            names = ", ".join(repr(self.body(body)) for body in roots)
            raise ModelError(f"bodies {names} stand in the world side by side, one of them free; a robot is one tree")
        bodies = [body for body in range(1, m.nbody) if m.body_rootid[body] in roots]
        if not free:
            self.links.append(Link(WORLD))
        gathered(self._add, bodies)
        for site in range(m.nsite):
            if m.site(site).name and m.site_bodyid[site] in bodies:
                self._add_site(site)
        for equality in np.flatnonzero(m.eq_active0):
            if m.eq_type[equality] != self.mj.mjtEq.mjEQ_JOINT:
                self._add_loop(int(equality), bodies if free else [0, *bodies])
        shapes = [pair for geom in range(m.ngeom) if m.geom_bodyid[geom] in bodies for pair in self._shapes(geom)]
        return Urdf(
            name=name,
            links=tuple(self.links),
            joints=tuple(self.joints),
            visuals=tuple(shape for geom, shape in shapes if m.geom_group[geom] < _DRAWN),
            collisions=tuple(shape for geom, shape in shapes if m.geom_contype[geom] or m.geom_conaffinity[geom]),
            folders=self.folders,
            base=Origin.of(m.body_pos[free[0]], self._matrix(m.body_quat[free[0]])) if free else None,
            left_out=tuple(self.left_out),
            loops=tuple(self.loops),
            poses={m.key(i).name or f"key_{i}": self._pose(m.key_qpos[i], free) for i in range(m.nkey)},
        )

    def _pose(self, qpos: Vec, free: list[int]) -> dict[str, list[float]]:
        """A keyframe: positions by joint, and where it puts a base that is free."""
        m = self.m
        pose = {self.joint(i): [float(qpos[m.jnt_qposadr[i]])] for i in range(m.njnt)}
        for body in free:
            x = qpos[m.jnt_qposadr[m.body_jntadr[body]] :][:7].tolist()
            pose[BASE] = [*x[:3], *x[4:], x[3]]
        return pose

    # ---- names
    def body(self, index: int) -> str:
        return str(self.m.body(index).name) or unused(f"body_{index}", self._link_names)

    def joint(self, index: int) -> str:
        return str(self.m.jnt(index).name) or unused(f"joint_{index}", self._joint_names)

    def _fix(self, parent: str, child: str, origin: Origin, how: str = "mount") -> None:
        """A link that is fixed to another, which has a joint's name too."""
        name = unused(f"{child}_{how}", self._joint_names)
        self.joints.append(Joint(name, "fixed", parent, child, origin))

    def _refuse_and_leave_out(self) -> None:
        m, ours = self.m, np.array([0.0, 0.0, -9.81])
        gravity = np.zeros(3) if m.opt.disableflags & self.mj.mjtDisableBit.mjDSBL_GRAVITY else m.opt.gravity
        if np.abs(gravity - ours).max() > _GRAVITY:
            self.left_out.append(f"gravity {triple(gravity)} m/s² is left out: here it is {triple(ours)}")
        for tendon in range(m.ntendon):
            name = m.tendon(tendon).name
            if m.tendon_armature[tendon]:
                raise ModelError(f"tendon {name!r} has an armature, which is not supported")
            self.left_out.append(f"tendon {name!r} is left out")
        for actuator in np.flatnonzero(~self._drives()):
            self.left_out.append(f"actuator {m.actuator(actuator).name!r} is left out: it moves no joint")

    def _drives(self) -> NDArray[np.bool_]:
        """Which actuators move a joint that has one position."""
        m, trn, jnt = self.m, self.mj.mjtTrn, self.mj.mjtJoint
        drives = np.isin(m.actuator_trntype, [int(trn.mjTRN_JOINT), int(trn.mjTRN_JOINTINPARENT)])
        drives[drives] = np.isin(m.jnt_type[m.actuator_trnid[drives, 0]], [int(jnt.mjJNT_HINGE), int(jnt.mjJNT_SLIDE)])
        return drives

    # ---- bodies
    def _roots(self) -> list[int]:
        """Children of the world with something that moves; the others are furniture."""
        m = self.m
        return sorted({int(m.body_rootid[body]) for body in range(1, m.nbody) if m.body_dofnum[body]})

    def _without_things(self, roots: list[int]) -> list[int]:
        """Those with joints, where there are any; a body that is free and has none is a thing beside the robot."""
        m = self.m
        joints = {root: int((m.body_rootid[m.jnt_bodyid] == root).sum()) for root in roots}
        things = [root for root in roots if self._is_free(root) and joints[root] == 1]
        if len(things) == len(roots):
            return roots
        self.left_out += [f"body {self.body(body)!r}, which is free and has no joints, is left out" for body in things]
        return [root for root in roots if root not in things]

    def _is_free(self, body: int) -> bool:
        m = self.m
        return bool(m.body_jntnum[body] and m.jnt_type[m.body_jntadr[body]] == self.mj.mjtJoint.mjJNT_FREE)

    def _add(self, body: int) -> None:
        """A link, and one more for each joint but the last; the last carries the mass, where the joint is."""
        m, name = self.m, self.body(body)
        if m.body_gravcomp[body]:
            raise ModelError(f"body {name!r} has gravcomp, which is not supported")
        inertial = self._inertial(body)
        if self._is_free(body):
            if m.dof_armature[m.body_dofadr[body]]:
                raise ModelError(
                    f"the free joint of body {name!r} has an armature: what flies has no rotor; write <freejoint/>, "
                    "which takes nothing from defaults"
                )
            self.links.append(Link(name, inertial))
            return
        parent = WORLD if m.body_parentid[body] == 0 else self.body(m.body_parentid[body])
        here = Origin.of(m.body_pos[body], self._matrix(m.body_quat[body]))
        joints = range(m.body_jntadr[body], m.body_jntadr[body] + m.body_jntnum[body])
        anchor = np.zeros(3)
        for joint in joints:
            step = m.jnt_pos[joint] - anchor
            origin = self._at_zero(joint, np.array(here.xyz) + here.rotation @ step, here.rotation)
            anchor = m.jnt_pos[joint]
            last = joint == joints[-1]
            child = name if last and not anchor.any() else unused(f"{name}/{self.joint(joint)}", self._link_names)
            self.links.append(Link(child, _moved(inertial, -anchor) if last else None))
            self.joints.append(self._joint(joint, parent, child, origin))
            parent, here = child, IDENTITY
        if parent != name:
            self.links.append(Link(name, None if joints else inertial))
            at = Origin(triple(-anchor)) if joints else here
            self._fix(parent, name, at)

    def _at_zero(self, joint: int, position: Vec, R: Mat) -> Origin:
        """Where the joint is at its position zero: the file draws it at its reference position."""
        m = self.m
        back = -float(m.qpos0[m.jnt_qposadr[joint]])
        if m.jnt_type[joint] == self.mj.mjtJoint.mjJNT_SLIDE:
            return Origin.of(position + back * R @ m.jnt_axis[joint], R)
        turn = np.zeros(4)
        self.mj.mju_axisAngle2Quat(turn, m.jnt_axis[joint], back)
        return Origin.of(position, R @ self._matrix(turn))

    def _add_site(self, site: int) -> None:
        m = self.m
        name, origin = str(m.site(site).name), Origin.of(m.site_pos[site], self._matrix(m.site_quat[site]))
        if name in self._body_names:
            name = unused(f"{name}_site", self._link_names)
        self.links.append(Link(name))
        self._fix(self.body(m.site_bodyid[site]), name, origin, "site")

    def _inertial(self, body: int) -> Inertial | None:
        m = self.m
        if not m.body_mass[body]:
            return None
        R = self._matrix(m.body_iquat[body])
        inertia = R @ np.diag(m.body_inertia[body]) @ R.T
        return Inertial(float(m.body_mass[body]), six(inertia), Origin(triple(m.body_ipos[body])))

    # ---- joints
    def _joint(self, joint: int, parent: str, child: str, origin: Origin) -> Joint:
        m, name, kinds = self.m, self.joint(joint), self.mj.mjtJoint
        limited, slides = bool(m.jnt_limited[joint]), m.jnt_type[joint] == kinds.mjJNT_SLIDE
        if not slides and m.jnt_type[joint] != kinds.mjJNT_HINGE:
            raise ModelError(f"joint {name!r} is a ball; joints may be hinge, slide and one free joint")
        if m.jnt_stiffness[joint] or m.jnt_stiffnesspoly[joint].any():
            self.left_out.append(f"the spring (stiffness) of joint {name!r} is left out")
        lower, upper = map(float, m.jnt_range[joint]) if limited else (-inf, inf)
        kind: JointKind = "prismatic" if slides else "revolute" if limited else "continuous"
        dof = m.jnt_dofadr[joint]
        if m.dof_dampingpoly[dof].any():
            self.left_out.append(f"the damping of joint {name!r} beyond its linear part is left out")
        if m.dof_armature[dof] < 0:
            raise ModelError(f"joint {name!r} has an armature of {m.dof_armature[dof]:g}; it must not be negative")
        mimics, ratio, offset = self.mimics.get(joint, (None, 1.0, 0.0))
        return Joint(
            name, kind, parent, child, origin, triple(m.jnt_axis[joint]), lower, upper,
            effort=self._effort(joint), damping=float(m.dof_damping[dof]), friction=float(m.dof_frictionloss[dof]),
            armature=float(m.dof_armature[dof]), mimics=mimics, mimic_ratio=ratio, mimic_offset=offset,
            reference=float(m.qpos0[m.jnt_qposadr[joint]]),
        )  # fmt: skip

    def _effort(self, joint: int) -> float:
        """What its actuators can do in either direction; without one nothing, in a file that has actuators at all."""
        m = self.m
        low, high = (0.0, 0.0) if m.nactuator else (-inf, inf)
        for actuator in map(int, np.flatnonzero(self._drives() & (m.actuator_trnid[:, 0] == joint))):
            damping = m.actuator_damping[actuator], *m.actuator_dampingpoly[actuator]
            if m.actuator_armature[actuator] or any(damping):
                raise ModelError(
                    f"an actuator of joint {self.joint(joint)!r} has armature or damping; give the joint's"
                )
            least, most = -inf, inf
            control = m.actuator_ctrladr[actuator]  # one that tracks has several
            if self._is_motor(actuator) and m.actuator_ctrllimited[control]:
                least, most = sorted(float(m.actuator_gainprm[actuator, 0]) * m.actuator_ctrlrange[control])
            if m.actuator_forcelimited[actuator]:
                least, most = np.clip((least, most), *m.actuator_forcerange[actuator])
            gear = float(m.actuator_gear[m.actuator_outadr[actuator], 0])
            ends = sorted((gear * least, gear * most)) if gear else (0.0, 0.0)
            low, high = low + float(ends[0]), high + float(ends[1])
        if m.jnt_actfrclimited[joint]:
            low, high = map(float, np.clip((low, high), *m.jnt_actfrcrange[joint]))
        effort = max(0.0, min(-low, high))
        if -low != high:
            given = f"joint {self.joint(joint)!r} is driven with {low:g} to {high:g}"
            self.left_out.append(f"{given}, of which what is beyond ±{effort:g} is left out")
        return effort

    def _is_motor(self, actuator: int) -> bool:
        m, mj = self.m, self.mj
        return bool(
            m.actuator_gaintype[actuator] == mj.mjtGain.mjGAIN_FIXED
            and m.actuator_biastype[actuator] == mj.mjtBias.mjBIAS_NONE
            and m.actuator_dyntype[actuator] == mj.mjtDyn.mjDYN_NONE
        )

    # ---- equalities
    def _add_mimic(self, equality: int) -> None:
        """q₁ − r₁ = c₀ + c₁ (q₂ − r₂), r the reference positions; MuJoCo's further powers have no gear."""
        m, powers = self.m, self.m.eq_data[equality, :5]
        joint, leader = int(m.eq_obj1id[equality]), int(m.eq_obj2id[equality])
        if leader < 0 or not powers[1] or powers[2:].any():
            self.left_out.append(f"equality <joint> {m.eq(equality).name!r} is left out: it is not a gear")
            return
        r_1, r_2 = m.qpos0[m.jnt_qposadr[[joint, leader]]]
        self.mimics[joint] = (self.joint(leader), float(powers[1]), float(powers[0] + r_1 - powers[1] * r_2))

    def _add_loop(self, equality: int, bodies: Sequence[int]) -> None:
        """Anchors are where MuJoCo's engine takes them: of a weld the first body's come second, and are turned."""
        m, kinds, data = self.m, self.mj.mjtEq, self.m.eq_data[equality]
        kind = kinds(int(m.eq_type[equality]))
        weld, name = kind == kinds.mjEQ_WELD, m.eq(equality).name or f"loop_{equality}"
        ends = [int(m.eq_obj1id[equality]), int(m.eq_obj2id[equality])]
        still = np.array([1.0, 0.0, 0.0, 0.0])
        if m.eq_objtype[equality] == self.mj.mjtObj.mjOBJ_SITE:
            anchors = [(m.site_pos[site], m.site_quat[site]) for site in ends]
            ends = [int(m.site_bodyid[site]) for site in ends]
        else:
            first, second = (data[3:6], data[:3]) if weld else (data[:3], data[3:6])
            anchors = [(first, data[6:10] if weld else still), (second, still)]
        if kind not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD) or not set(ends) <= set(bodies):
            word = kind.name.removeprefix("mjEQ_").lower()
            self.left_out.append(f"equality <{word}> {m.eq(equality).name!r} is left out: it joins no two links")
            return
        frame, to = (
            self._add_frame(body, *anchor, f"{name}_{i}")
            for i, (body, anchor) in enumerate(zip(ends, anchors, strict=True), start=1)
        )
        self.loops.append(Loop(name, frame, to, weld))

    def _add_frame(self, body: int, position: Vec, quaternion: Vec, name: str) -> str:
        """A link at a place on a body; the body's own where that is its place."""
        carrier, R = self.body(body) if body else WORLD, self._matrix(quaternion)
        if not position.any() and np.array_equal(R, np.eye(3)):
            return carrier
        name = unused(name, self._link_names)
        self.links.append(Link(name))
        self._fix(carrier, name, Origin.of(position, R))
        return name

    # ---- shapes
    def _shapes(self, geom: int) -> Iterator[tuple[int, Geometry]]:
        m, kinds = self.m, self.mj.mjtGeom
        body, size = self.body(m.geom_bodyid[geom]), triple(m.geom_size[geom])
        at, R = m.geom_pos[geom], self._matrix(m.geom_quat[geom])
        material = m.geom_matid[geom]
        own = material < 0 or not np.array_equal(m.geom_rgba[geom], _GREY)  # a colour that is not the default's
        color = cast("Color", tuple(map(float, m.geom_rgba[geom] if own else m.mat_rgba[material])))
        shapes: list[tuple[Shape, Vec]]
        match self.mj.mjtGeom(int(m.geom_type[geom])):
            case kinds.mjGEOM_BOX:
                shapes = [(Box((2 * size[0], 2 * size[1], 2 * size[2])), at)]
            case kinds.mjGEOM_SPHERE:
                shapes = [(Sphere(size[0]), at)]
            case kinds.mjGEOM_CYLINDER:
                shapes = [(Cylinder(size[0], 2 * size[1]), at)]
            case kinds.mjGEOM_CAPSULE:
                shapes = [(part, at + R @ place) for part, place in capsule(size[0], 2 * size[1])]
            case kinds.mjGEOM_MESH:
                mesh, at, R = self._mesh(int(m.geom_dataid[geom]), at, R)
                shapes = [(mesh, at)]
            case other:
                kind = other.name.removeprefix("mjGEOM_").lower()
                raise ModelError(f"a geom of body {body!r} is of type {kind}, which is not supported")
        for shape, place in shapes:
            yield geom, Geometry(body, shape, Origin.of(place, R), color)

    def _mesh(self, mesh: int, at: Vec, R: Mat) -> tuple[Mesh, Vec, Mat]:
        """The compiler moves the vertices of a mesh into its own centre and axes; in its file they are as they were."""
        m = self.m
        if self.meshes is not None:
            R = R @ self._matrix(m.mesh_quat[mesh]).T
            return Mesh(self.meshes[m.mesh(mesh).name], triple(m.mesh_scale[mesh])), at - R @ m.mesh_pos[mesh], R
        path = self.folders.home / f"{mesh}.obj"
        if not path.exists():
            points = m.mesh_vert[m.mesh_vertadr[mesh] :][: m.mesh_vertnum[mesh]].tolist()
            faces = (m.mesh_face[m.mesh_faceadr[mesh] :][: m.mesh_facenum[mesh]] + 1).tolist()
            lines = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in faces]
            path.write_text("\n".join(lines), encoding="ascii")
        return Mesh(path), at, R

    def _matrix(self, quaternion: Vec) -> Mat:
        R = np.zeros(9)
        self.mj.mju_quat2Mat(R, quaternion)
        return R.reshape(3, 3)


def _moved(inertial: Inertial | None, step: Vec) -> Inertial | None:
    """The same mass seen from a frame whose axes are parallel and whose origin lies at -step."""
    if inertial is None:
        return None
    return Inertial(inertial.mass, inertial.inertia, Origin(triple(np.array(inertial.origin.xyz) + step)))
