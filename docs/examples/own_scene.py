"""A MuJoCo scene and loop of your own: a four-bar linkage with one motor, and a ball that is not the robot's."""

import mujoco
import numpy as np

import wbc
from wbc.sim.bridge import Bridge
from wbc.tasks import Posture, Sinusoid, Torque, TorqueLimits, loop_closures

scene = mujoco.MjModel.from_xml_string("""<mujoco>
  <option timestep="0.0005" integrator="implicitfast"/> <default><equality solref="0.002 1"/></default>
  <worldbody>
    <body pos="2 0 1"><freejoint/><geom size="0.1"/></body>
    <body><joint name="crank" axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.3" contype="0"/>
      <body pos="0 0 0.3"><joint name="coupler" axis="0 1 0"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.4 0 0" contype="0"/><site name="end" pos="0.4 0 0"/>
      </body></body>
    <body pos="0.4 0 0"><joint name="rocker" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.3" contype="0"/><site name="pin" pos="0 0 0.3"/></body>
  </worldbody>
  <equality><connect name="loop" site1="end" site2="pin"/></equality>
</mujoco>""")
data, robot, dt = mujoco.MjData(scene), wbc.load(scene), scene.opt.timestep
bridge = Bridge(robot, scene)  # joints in our order, and the conventions of q and v
passive = Torque(0.0, joints=["coupler", "rocker"]).exactly()
stack = wbc.Stack(
    [Posture(Sinusoid([0.0], amplitude=0.4, frequency=0.5), joints=["crank"], kp=400.0)],
    contacts=loop_closures(robot),
    subject_to=[passive, TorqueLimits(10.0)],
)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
errors = []
for tick in range(4000):
    command = controller.tick(dt * tick, *bridge.read(data))
    assert command.status.ok, controller.why
    data.qfrc_applied[[bridge.velocity_index(joint) for joint in range(robot.nj)]] = command.tau
    mujoco.mj_step(scene, data)
    errors.append(abs(controller.plan.errors()["Posture[crank]"][0]))
print(f"crank at most {1e3 * max(errors):.2f} mrad off, the loop pulls with {np.linalg.norm(command.f['loop']):.1f} N")
assert max(errors) < 2e-3
