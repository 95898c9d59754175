"""A record of your own loop, tick by tick, as a table for other programs and as a report."""

import numpy as np

import wbc
from wbc.report import save_report
from wbc.tasks import JointLimits, Position, Posture, Sinusoid

robot, dt = wbc.load("arm"), 2e-3
path = Sinusoid([0.4, 0.0, 0.5], amplitude=[0.0, 0.1, 0.1], frequency=0.5)
stack = wbc.Stack([Position("tool", target=path), Posture(robot.q0, weight=1e-3)], subject_to=[JointLimits()])
controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=dt)

recorder = wbc.Recorder(1000)
q, v = robot.q0, np.zeros(robot.nv)
for tick in range(1000):
    command = recorder.tick(controller, dt * tick, q, v, battery=48.0 - 1e-3 * tick)  # columns of your own by name
    q, v = command.q, command.v

run = recorder.run({"operator": "me"})
page = save_report(run, "recorded", robot=robot)  # recorded/report.html; run.npz and meta.json beside it
table = run.to_csv("recorded.csv")  # run.to_pandas() is the same table
print(page, table, f"{run.rows} ticks", *list(run)[:5])
again = wbc.Run.load("recorded")
assert np.array_equal(again["q"], run["q"]) and page.is_file()
assert "error.Position[tool].x [m]" in table.read_text(encoding="utf-8").splitlines()[0]
