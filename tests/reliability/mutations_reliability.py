"""Slips in what keeps commands bounded and conflicts named."""

CONFLICT, LADDER, FALLBACK = "wbc/qp/conflict.py", "wbc/control/ladder.py", "wbc/control/fallback.py"
WATCHDOG, CONTROLLER = "wbc/control/watchdog.py", "wbc/control/controller.py"
OF_CONFLICT, OF_LADDER = "tests/qp/test_conflict.py", "tests/control/test_ladder.py"
OF_WATCHDOG = "tests/control/test_watchdog.py"

MUTATIONS = [
    (CONFLICT, "kept = kept[found[kept] != 0.0]", "kept = kept", OF_CONFLICT),
    (
        "wbc/qp/solvers/osqp_.py",
        "if answer.status is Status.MAX_ITERATIONS:",
        "if False:",
        "tests/qp/test_agreement.py",
    ),
    (CONFLICT, "amounts = s.dot(s) / s * system.size[kept]", "amounts = s.dot(s) / s", OF_CONFLICT),
    (CONFLICT, "for kind in range(3):", "for kind in (2, 1, 0):", OF_CONFLICT),
    (CONFLICT, "while N.shape[1] > 1:", "while N.shape[1] > 2:", "tests/reliability/test_conflicts.py"),
    (LADDER, "if stopped and self._solved < self.recovery.resume_after:", "if False:", OF_LADDER),
    (LADDER, "held = self.good if self.failures <= self.recovery.hold_ticks else None", "held = self.good", OF_LADDER),
    (LADDER, "np.clip(torques, *plan.torque_range, out=torques)", "pass", OF_LADDER),
    (LADDER, "        if self._limited():\n", "        if True:\n", OF_LADDER),
    (
        LADDER,
        "            self.failures += 1\n        self._controller.status",
        "            pass\n        self._controller.status",
        OF_LADDER,
    ),
    (FALLBACK, "most: Vec = braking * plan.dt", "most: Vec = 0.5 * braking * plan.dt", OF_LADDER),
    (WATCHDOG, "self.missed += round(step / self._dt) - 1", "self.missed += round(step / self._dt)", OF_WATCHDOG),
    (WATCHDOG, "if step < 0.0:", "if step < -1.0:", OF_WATCHDOG),
    (CONTROLLER, "except Exception as cause:  # a back end", "except ValueError as cause:  # a back end", OF_LADDER),
]
