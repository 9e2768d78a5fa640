"""Small scenarios for robots as processes, and what must be equal of two plans."""

ROBOT = """
[[robots]]
name = "{name}"
start = [{x}, {y}, 0.0]
start_sigmas = [0.01, 0.01, 0.01]
goal = [{x}, {y}]
sensors = ["range"]
motion = {{ sigmas = [0.01, 0.01, 0.01] }}
"""

GATHERING = (
    """
schema = 1
name = "two gather"
seed = 3
[world]
bounds = [[0.0, 0.0], [4.0, 4.0]]
[sensors.range]
kind = "proportional_range"
slope = 0.25
max_range_m = 1.0
"""
    + ROBOT.format(name="ann", x=0.5, y=0.5)
    + ROBOT.format(name="bob", x=3.5, y=3.5)
    + """
[[targets]]
name = "t0"
mean = [1.6, 1.2]
sigmas = [0.45, 0.45]
[[targets]]
name = "t1"
mean = [2.4, 3.0]
sigmas = [0.45, 0.45]
[planner]
name = "distributed_aia"
[planner.distributed_aia]
dynamics = "differential_drive"
delta = 1e-4
iterations = 3000
"""
)

MEETINGS = (
    """
schema = 1
name = "two meet"
seed = 2
[world]
bounds = [[0.0, 0.0], [6.0, 6.0]]
[sensors.range]
kind = "clamped_range"
max_range_m = 4.0
"""
    + ROBOT.format(name="ann", x=1.0, y=3.0)
    + ROBOT.format(name="bob", x=3.0, y=3.0)
    + """
[[targets]]
name = "t0"
mean = [1.2, 1.3, 1.0]
sigmas = [0.4, 0.4, 0.4]
process = [[2e-4, 0.0, 0.0], [0.0, 2e-4, 0.0], [0.0, 0.0, 1e-6]]
[[targets]]
name = "t1"
mean = [4.8, 1.5, 0.8]
sigmas = [0.4, 0.4, 0.4]
process = [[2e-4, 0.0, 0.0], [0.0, 2e-4, 0.0], [0.0, 0.0, 1e-6]]
[planner]
name = "intermittent"
[planner.intermittent]
teams = [["ann", "bob"], ["bob", "ann"]]
steps = 80
samples = 60
explore = 30
range_m = 0.3
delta = 0.05
step_m = 0.3
wait_steps = 3
recovery_steps = 20
"""
)


def without_work(plan):
    """A plan, as plain data, without what depends on who is faster."""
    kept = {name: value for name, value in plan.items() if name not in _WORK}
    kept["details"] = {k: v for k, v in plan["details"].items() if k != "bytes_per_node"}
    return kept


_WORK = ("seconds", "traffic", "report", "warnings")
