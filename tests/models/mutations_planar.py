"""Slips in the planar robots and in the derivation, and the test that each must fail."""

PR, FOUR, PLANAR = "wbc/models/planar_pr.py", "wbc/models/planar_4p.py", "wbc/models/planar.py"
DERIVATION, PARAMETRISATION = "wbc/models/lagrange/derivation.py", "wbc/models/lagrange/parametrisation.py"
HAND = "tests/models/test_planar.py::test_the_formulas_by_hand_are_those_of_the_derivation"
MOVES = "tests/models/test_planar.py::test_frames_and_the_centre_of_mass_move_as_in_pinocchio"
LAGRANGE = "tests/models/test_lagrange.py"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # a sign
    (PR, "coupling = -self._first * np.sin(self.vector", "coupling = self._first * np.sin(self.vector", HAND),
    (PR, "cos * v[1] * self.vector", "-cos * v[1] * self.vector", HAND),
    (PR, "(v[0] * v[1] + self.g0)", "(v[0] * v[1] - self.g0)", HAND),
    # a term, an index
    (PR, "np.cos(q[1]) * v[1] ** 2, 0.0]", "np.cos(q[1]) * v[0] * v[1], 0.0]", HAND),
    (PR, '+ p["m2"] * p["d2"] ** 2', "", HAND),
    (PR, "towards_joint * np.sin(q[1])", "towards_joint * np.cos(q[1])", HAND),
    (FOUR, "0.0, a4 * self.g0])", "0.0, a2 * self.g0])", HAND),
    (FOUR, "((m2 + m3) * q2 + m4", "(m2 * q2 + m4", HAND),
    (
        FOUR,
        "below, below, y]",
        "below, y, y]",
        "tests/models/test_planar.py::test_the_four_masses_and_the_four_coefficients_give_the_same_forces",
    ),
    (FOUR, "return np.diag([a3, a4])", "return np.diag([a4, a3])", "tests/models/test_planar.py"),
    # kinematics
    (PLANAR, "+= 2.0 * omega * v[i]", "+= omega * v[i]", MOVES),
    (PLANAR, "self.drift - omega**2 * arm", "self.drift + omega**2 * arm", MOVES),
    (PLANAR, "- np.cross(velocity[3:], velocity[:3])", "", MOVES),
    # a bound
    (PLANAR, 'if name[0] == "d" else 0.0 for', "for", "tests/models/test_planar.py"),
    # symbols
    (DERIVATION, "- sp.diff(M[i, j], q[k])) / 2", "+ sp.diff(M[i, j], q[k])) / 2", LAGRANGE),
    (DERIVATION, "-self.S.T * sp.Matrix(self.v)", "-self.S * sp.Matrix(self.v)", LAGRANGE),
    (DERIVATION, "sp.Matrix([-along[1], along[0]])", "sp.Matrix([along[1], along[0]])", LAGRANGE),
    (DERIVATION, " + inertia * omega**2 / 2)", ")", LAGRANGE),
    (PARAMETRISATION, "common = -common", "pass", LAGRANGE),
    (PARAMETRISATION, "term.factor * share * term.function", "share * term.function", LAGRANGE),
    (PARAMETRISATION, "[entries[row, j] for row", "[entries[0, j] for row", LAGRANGE),
]
