"""Motion of people in, motion of robots out, and a verdict for every frame."""

from wbc.motion.clip import Motion as Motion
from wbc.motion.made import made as made
from wbc.motion.mapping import Follower as Follower
from wbc.motion.mapping import Table as Table
from wbc.motion.retargeted import Retargeted as Retargeted
from wbc.motion.retargeting import retarget as retarget
from wbc.motion.witness import Fault as Fault
from wbc.motion.witness import Verdict as Verdict
from wbc.motion.witness import Witness as Witness
