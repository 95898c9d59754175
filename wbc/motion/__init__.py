"""Motion of people in, motion of robots out, and a verdict for every frame."""

from wbc.motion.clip import Motion as Motion
from wbc.motion.judged import Judged as Judged
from wbc.motion.made import made as made
from wbc.motion.mapping import Follower as Follower
from wbc.motion.mapping import Table as Table
from wbc.motion.retargeted import Retargeted as Retargeted
from wbc.motion.retargeted import retarget as retarget
from wbc.motion.verdict import Fault as Fault
from wbc.motion.verdict import Verdict as Verdict
from wbc.motion.witness import Witness as Witness
