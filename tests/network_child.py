"""A robot in a process of its own, for tests of the transport: ``python network_child.py JSON``.

It prints a line when it sees its team, does what its role says, and prints a line of JSON at the
end. ``hold`` holds the interpreter lock for some seconds when it is told to; ``gather`` runs the
endpoint with the step of ``gathering``.
"""

import json
import sys
import time

from gathering import GatherState, gather_step

from fgplan.team.endpoint import run_robot
from fgplan.team.envelope import Envelope
from fgplan.team.network_options import NetworkOptions
from fgplan.team.zenoh_transport import ZenohTransport

LONG_S = 60.0
"""So long it waits for others, whose imports may take long."""


def say(**what):
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def hold(network, seconds):
    """Answer "hold" by holding the lock; count the notes that arrive; end at "end"."""
    numbers = []
    while network.wait(LONG_S):
        for envelope in network.receive(network.robot):
            if envelope.kind == "hold":
                say(holding=True)
                began = time.perf_counter()
                sys.setswitchinterval(1000.0)  # nobody may ask for the lock meanwhile
                while time.perf_counter() < began + seconds:
                    pass
                sys.setswitchinterval(0.005)
                say(held_s=time.perf_counter() - began)
            elif envelope.kind == "end":
                say(numbers=len(numbers), in_order=numbers == sorted(numbers))
                return
            elif envelope.kind == "ping":
                network.send(
                    network.robot,
                    Envelope(robot=network.robot, session=0, sequence=0, kind="pong"),
                    envelope.robot,
                )
            else:
                numbers.append(envelope.sequence)


def main():
    given = json.loads(sys.argv[1])
    robots = tuple(given["robots"])
    with ZenohTransport(given["robot"], robots, NetworkOptions(**given["network"])) as network:
        if given.get("wait", True):
            network.wait_for_team(LONG_S)
        say(ready=True, present=sorted(network.present(network.robot)))
        if given["role"] == "hold":
            hold(network, given["seconds"])
            return
        end = run_robot(
            GatherState(robot=given["robot"], robots=robots),
            gather_step,
            network,
            time_limit_s=given.get("time_limit_s", 2 * LONG_S),
            linger_s=given.get("linger_s", LONG_S),
        )
        say(finished=end.finished, numbers=end.numbers, refused=network.refused.counts)


if __name__ == "__main__":
    main()
