"""Slips in criteria, torque tasks and components, and the test that each must fail."""

OBSERVER, ADAPTIVE = "tasks/components/momentum_observer.py", "tasks/components/slotine_li.py"
MANIPULABILITY, TORQUE = "tasks/criteria/manipulability.py", "tasks/torque.py"
GRADIENTS = "tests/tasks/test_projected_gradient.py::test_gradients_are_analytic_and_equal_central_differences"
CLOSED_FORM = "tests/tasks/test_projected_gradient.py::test_without_active_limits_it_is_the_closed_form"
TARGETS = "tests/tasks/test_targets.py"
WRENCH = "tests/tasks/test_measured_wrench.py"
SEES, ADAPTS = "tests/tasks/test_momentum_observer.py", "tests/tasks/test_slotine_li.py"
LOAD, LOADS = "tasks/components/load.py", "tests/tasks/test_load.py"
REACTION, REACTIONS = "tasks/components/fault_reaction.py", "tasks/components/reactions.py"
DIAGNOSIS, REACTS = "tasks/components/diagnosis.py", "tests/tasks/test_fault_reaction.py"
BODIES, REGRESSOR = "tests/methods/test_pseudo_inertia.py", "tests/models/test_inertial_regressor.py"
ARMS = "tests/tasks/test_slotine_li_arms.py"
FLIES = "tests/tasks/test_momentum_observer_floating.py"
LAW = f"{ADAPTS}::test_with_no_limit_active_the_command_is_the_law"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # criteria and their task
    (MANIPULABILITY, "turned = cross(a, Ga) + cross(w, Gw)", "turned = cross(a, Ga) - cross(w, Gw)", GRADIENTS),
    (MANIPULABILITY, "np.cumsum(moved, axis=1) - moved", "np.cumsum(moved, axis=1)", GRADIENTS),
    (MANIPULABILITY, "(left * others) @ right", "(left * sizes) @ right", GRADIENTS),
    ("tasks/criteria/mid_range.py", "self._middle - state.q_joints", "state.q_joints - self._middle", GRADIENTS),
    ("tasks/criteria/clearance.py", "self.reach - d) * away", "self.reach + d) * away", GRADIENTS),
    ("tasks/projected_gradient.py", "= self.gain * self", "= -self.gain * self", CLOSED_FORM),
    # torques and forces
    (TORQUE, "[0][nb:, nb:]", "[0][: state.model.nj, : state.model.nj]", TARGETS),
    (TORQUE, "np.dot(out.A, tau_0, out.b)", "np.copyto(out.b, tau_0)", TARGETS),
    ("tasks/position.py", '"xz": slice(0, 3, 2)', '"xz": slice(0, 2)', TARGETS),
    ("tasks/components/measured_wrench.py", "plan.extra_bias -= ", "plan.extra_bias += ", WRENCH),
    ("wbc/control/controller.py", "plan.extra_bias[:] = 0.0", "pass", WRENCH),
    # the observer
    (OBSERVER, "state.g - state.v @ state.coriolis", "state.g - state.coriolis @ state.v", SEES),
    (OBSERVER, "state.g - state.v", "-state.v", SEES),
    (OBSERVER, "0.5 * (self._beta + beta)", "beta", SEES),
    (OBSERVER, "self._sent = -self._plan.extra_bias", "self._sent = 0.0 * self._plan.extra_bias", SEES),
    (OBSERVER, "self._observer.reset(p)", "self._observer.reset(0.0 * p)", SEES),
    (OBSERVER, "M[:nb, :nb], M[:nb, nb:]).T", "M[:nb, :nb], 0.0 * M[:nb, nb:]).T", FLIES),
    (OBSERVER, "+ self._measured_force()", "- self._measured_force()", FLIES),
    (OBSERVER, "self._viscous * v +", "-self._viscous * v +", FLIES),
    # diagnosis and reaction
    (DIAGNOSIS, "total = observer.missing + known", "total = observer.missing", REACTS),
    (DIAGNOSIS, "10.0 * self.noise[i] ** 2", "1e9", REACTS),
    (DIAGNOSIS, "(u - m) ** 2 / n", "(u + m) ** 2 / n", REACTS),
    ("tasks/components/reactions.py", "1.0 - diagnosis.share", "diagnosis.share", REACTS),
    ("tasks/components/reactions.py", "offset=diagnosis.offset", "offset=-diagnosis.offset", REACTS),
    ("tasks/components/reactions.py", "low[i] = high[i] = 0.0", "pass", REACTS),
    (
        DIAGNOSIS,
        "abs(missing[i]) < max(",
        "abs(missing[i]) > max(",
        f"{REACTS}::test_a_dead_motor_stays_dead_when_it_is_looked_at_again",
    ),
    (DIAGNOSIS, "or since.uu[i] > 0.0", "", f"{REACTS}::test_other_reactions_change_the_tasks_they_speak_of"),
    (
        REACTION,
        "self._before.restore(plan)",
        "self._before.restore_tasks()",
        f"{REACTS}::test_a_push_on_one_joint_that_looks_like_a_dead_motor_is_told_from_one",
    ),
    (
        REACTION,
        "decided.joint not in diagnosis.instead_of",
        "False",
        f"{REACTS}::test_what_is_taken_back_for_one_motor_stays_for_another",
    ),
    # loads
    (
        LOAD,
        "J[:3] - np.cross",
        "J[:3] + np.cross",
        f"{LOADS}::test_weight_and_inertia_are_the_difference_that_the_load_makes",
    ),
    (
        LOAD,
        "rest[3:, 1:] = np.cross(v, turning.T).T",
        "pass",
        f"{LOADS}::test_the_regressor_is_what_inverse_dynamics_asks_for_the_load",
    ),
    (
        LOAD,
        "np.cross(R.T, v).T",
        "np.cross(v, R.T).T",
        f"{LOADS}::test_the_regressor_is_what_inverse_dynamics_asks_for_the_load",
    ),
    (LOAD, "not mass > 0.0 or", "", f"{LOADS}::test_what_is_no_load_is_not_called_one"),
    (LOAD, "or constant < CLEARLY**2 * left", "", f"{LOADS}::test_what_is_no_load_is_not_called_one"),
    (
        REACTIONS,
        "plan.extra_bias += diagnosis.load.weight(state)",
        "pass",
        f"{LOADS}::test_a_load_that_was_taken_for_a_push_is_recognised_and_carried",
    ),
    (
        OBSERVER,
        "known -= Y @ load",
        "known += Y @ load",
        f"{LOADS}::test_a_load_that_was_taken_for_a_push_is_recognised_and_carried",
    ),
    ("wbc/stack/actuators.py", "(tau + self._offset)", "(tau - self._offset)", "tests/stack/test_actuators.py"),
    # the adaptive law
    (ADAPTIVE, "self._kp / self._kd", "self._kd / self._kp", LAW),
    ("tasks/components/reference.py", "wanted.second + self._ratio", "wanted.second - self._ratio", LAW),
    (ADAPTIVE, "+ self._kd * e_rate", "- self._kd * e_rate", LAW),
    (ADAPTIVE, "gradient = self._Y.T @ self._s", "gradient = -self._Y.T @ self._s", ADAPTS),
    ("wbc/methods/pseudo_inertia.py", "np.maximum(values, self.floor)", "np.abs(values)", BODIES),
    ("wbc/methods/pseudo_inertia.py", "cl=self.floor - values", "cl=self.floor + values", BODIES),
    ("wbc/models/inertial_regressor.py", "0.5 * coriolis", "coriolis", REGRESSOR),
    ("wbc/models/inertial_regressor.py", "(2.0 * step)", "step", REGRESSOR),
    ("tasks/components/prediction.py", "(Y_p - self._momentum) + self._drive", "(Y_p - self._momentum)", ARMS),
    # an actuator
    (
        "wbc/sim/actuator_fault.py",
        "(1.0 - self.effectiveness) * tau",
        "self.effectiveness * tau",
        "tests/sim/test_actuator_fault.py",
    ),
]
