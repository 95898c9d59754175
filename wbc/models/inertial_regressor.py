"""InertialRegressor: the dynamics of an arm as a matrix times what it weighs, and how few numbers that is."""

from __future__ import annotations

from typing import final

import numpy as np
import pinocchio as pin
from scipy.linalg import qr, solve_triangular

from wbc import checks
from wbc.errors import NotSupported
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.types import Index, Mat, Vec

#: Parameters of a link: mass, first moments, and inertia about the joint's frame, as Pinocchio orders them.
NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
#: Columns whose part independent of the others is smaller than this share of the largest add nothing.
RANK = 1e-9
#: Motions from which the independent columns are read: more than enough for 10 parameters a link.
MOTIONS = 50


@final
class InertialRegressor:
    """Y (nj, p) with M(q) a_r + C(q, v) v_r + g(q) = Y(q, v, v_r, a_r) π + rotors a_r, for arms on a fixed base.

    π (p,) are ten numbers a link, p = 10 nj: mass [kg], first moments [kg m], inertia [kg m²], all in the frame of the
    joint that moves the link. :attr:`rotors` (nj,) are the inertias that MJCF calls armature, 0 in a URDF: they are on
    the diagonal of M and no part of π.

    Pinocchio knows Y for v_r = v; Coriolis terms are quadratic in v, so that polarisation,

        C(q, v) v_r = ½ [c(v + v_r) − c(v) − c(v_r)],   c(v) = C(q, v) v,

    gives the rest with the C of Christoffel's symbols, for which Ṁ − 2 C is skew-symmetric. It needs v = q̇: joints that
    are revolute or prismatic, and a base that is fixed.

    Not all of π shows in torques. :attr:`independent` (b,) are the columns of a largest independent set, found by QR
    with pivoting on random motions, and :attr:`grouping` (b, p) makes the base parameters of π: Y π =
    Y[:, independent] (grouping π) for every motion. Source: Gautier, Khalil, IEEE T-RA 1990.

    Raises:
        NotSupported: a robot that is not from a URDF, has a floating base, or a joint whose velocity is not q̇.

    Example:
        >>> from wbc.models import load
        >>> from wbc.models.inertial_regressor import InertialRegressor
        >>> regressor = InertialRegressor(load("arm"))
        >>> regressor.parameters.shape, regressor.grouping.shape[1]
        ((70,), 70)
    """

    def __init__(self, model: RobotModel) -> None:
        checks.instance("model", model, RobotModel, "a robot from wbc.load(...)")
        if not isinstance(model, PinocchioModel):
            raise NotSupported(f"{model.name} is a {type(model).__name__}; a regressor needs a robot from a URDF")
        if model.nb:
            raise NotSupported(f"{model.name} has a floating base; the regressor needs a fixed one, where v = dq/dt")
        if model.nq != model.nv:
            raise NotSupported(f"{model.name} has joints whose velocity is not the derivative of their position")
        self.model = model
        self._pin, self._data = model.pinocchio, model.pinocchio.createData()
        self._zero = np.zeros(model.nv)
        links = [self._pin.inertias[i] for i in range(1, self._pin.njoints)]
        #: Inertia of each joint's rotor (nj,) [kg m², kg], known.
        self.rotors: Vec = np.array(self._pin.armature)
        #: π of the model (p,).
        self.parameters: Vec = np.concatenate([link.toDynamicParameters() for link in links])
        self.names = tuple(f"{joint} {name}" for joint in model.joint_names for name in NAMES)
        self.independent, self.grouping = self.grouped(np.arange(len(self.parameters)))

    def __call__(self, q: Vec, v: Vec, v_r: Vec, a_r: Vec) -> Mat:
        """Y (nj, p)."""
        zero, known = self._zero, self._known
        at_rest = known(q, zero, zero)
        coriolis = known(q, v + v_r, zero) - known(q, v, zero) - known(q, v_r, zero) + at_rest
        result: Mat = known(q, zero, a_r) + 0.5 * coriolis
        return result

    def momentum(self, q: Vec, v: Vec) -> Mat:
        """Y_p (nj, p) with M(q) v = Y_p π + rotors v."""
        result: Mat = self._known(q, self._zero, v) - self._known(q, self._zero, self._zero)
        return result

    def drive(self, q: Vec, v: Vec, *, step: float = 1e-6) -> Mat:
        """Y_β (nj, p) with g − C(q, v)ᵀ v = Y_β π: what changes the momentum beside the torques.

        Cᵀ v = Ṁ v − C v; Ṁ v is the change of the momentum of this velocity along q̇, by a central difference.
        """
        moved = self.momentum(q + step * v, v) - self.momentum(q - step * v, v)
        result: Mat = self._known(q, v, self._zero) - moved / (2.0 * step)
        return result

    def inertia(self, q: Vec, parameters: Vec) -> Mat:
        """M(q) (nj, nj) of links with other parameters (p,), without rotors."""
        columns = [(self.momentum(q, unit) @ parameters) for unit in np.eye(self.model.nv)]
        M = np.array(columns).T
        return 0.5 * (M + M.T)

    def _known(self, q: Vec, v: Vec, a: Vec) -> Mat:
        found = pin.computeJointTorqueRegressor(self._pin, self._data, q, v, a)
        return np.array(found).reshape(self.model.nv, -1)  # of a single joint Pinocchio gives a vector

    def grouped(self, columns: Index) -> tuple[Index, Mat]:
        """A largest independent set (b,) of these columns of Y, and what groups their parameters, (b, len(columns)).

        The parameters of the other columns are taken for known.
        """
        random, nv = np.random.default_rng(0), self.model.nv
        rows = []
        for _ in range(MOTIONS):
            q, (v, a) = self.model.random_configuration(random), 3.0 * random.standard_normal((2, nv))
            rows.append(self._known(q, v, a))
        stacked = np.vstack(rows)[:, columns]
        R, order = qr(stacked, mode="r", pivoting=True)
        sizes = np.abs(R.diagonal())
        rank = int((sizes > RANK * sizes[0]).sum())
        grouping = np.zeros((rank, stacked.shape[1]))
        grouping[np.arange(rank), order[:rank]] = 1.0
        grouping[:, order[rank:]] = solve_triangular(R[:rank, :rank], R[:rank, rank:])
        by_index = np.argsort(order[:rank])
        return columns[order[:rank][by_index]], grouping[by_index]
