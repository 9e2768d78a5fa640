"""Who is there: when each teammate was heard of last, and who counts as lost.

A teammate is heard of by a status or a fresh entry of its own, and for as long as the network sees
it; what the network sees may hang, so how long it has said nothing counts on its own too. A robot
that was not stepped for long (frozen, or busy with one long evaluation) has heard nobody meanwhile:
for it that time did not pass.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from fgplan.team.envelope import Inbox
from fgplan.team.robot_setup import RobotSetup


@dataclass(frozen=True, slots=True, kw_only=True)
class Presence:
    """What a robot knows of who is there; a value.

    Attributes:
        now_s: Time of the last step, seconds; None before the first.
        began_s: Time of the first step, seconds; None before it.
        heard_s: When each teammate was heard of last, seconds.
        spoke_s: When each teammate said something last, seconds.
        seen: Teammates that the network saw at the last step.
        told: Whether the network tells who is there.
    """

    now_s: float | None = None
    began_s: float | None = None
    heard_s: Mapping[str, float] = field(default_factory=dict)
    spoke_s: Mapping[str, float] = field(default_factory=dict)
    seen: frozenset[str] = frozenset()
    told: bool = False

    def lost(self, after_s: float, hung_after_s: float = math.inf) -> frozenset[str]:
        """Teammates that were not heard of for so long, or said nothing for that long and longer.

        Args:
            after_s: Seconds without a sign.
            hung_after_s: Seconds of silence of one whom the network sees.
        """
        if after_s == math.inf or self.now_s is None:
            return frozenset()
        heard_s = self.now_s - after_s
        spoke_s = self.now_s - max(after_s, hung_after_s)
        return frozenset(
            robot
            for robot, last_s in self.heard_s.items()
            if last_s < heard_s or self.spoke_s[robot] < spoke_s
        )

    def hear(self, robot: str) -> "Presence":
        """The same, a teammate having said something now."""
        now_s = self.now_s or 0.0
        return replace(
            self,
            heard_s={**self.heard_s, robot: now_s},
            spoke_s={**self.spoke_s, robot: now_s},
        )


def look_round(
    presence: Presence, setup: RobotSetup, inbox: Inbox
) -> tuple[Presence, tuple[str, ...]]:
    """Take in the time and what the network says.

    Args:
        presence: After the last step.
        setup: What the robot knows.
        inbox: Of this step.

    Returns:
        Who is there now, and teammates that the network sees anew, in the order of the team.
    """
    now_s = inbox.now_s
    seen = frozenset(inbox.present or ()) & frozenset(setup.others)
    if presence.now_s is None:
        heard = spoke = dict.fromkeys(setup.others, now_s)
    else:
        gap_s = now_s - presence.now_s
        away_s = gap_s if gap_s > setup.options.lost_after_s / 2.0 else 0.0
        heard = {robot: time_s + away_s for robot, time_s in presence.heard_s.items()}
        heard |= dict.fromkeys(seen, now_s)
        spoke = {robot: time_s + away_s for robot, time_s in presence.spoke_s.items()}
    appeared = tuple(robot for robot in setup.others if robot in seen - presence.seen)
    told = inbox.present is not None
    began_s = now_s if presence.began_s is None else presence.began_s
    after = Presence(
        now_s=now_s, began_s=began_s, heard_s=heard, spoke_s=spoke, seen=seen, told=told
    )
    return after, appeared
