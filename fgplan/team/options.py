"""How a team comes to agree: order of turns, tolerance, what to do where something is missing."""

import math
from dataclasses import dataclass
from typing import Literal

from fgplan.checks import check_not_negative, check_positive
from fgplan.errors import InvalidInputError

Order = Literal["fixed", "random"]
WithoutPath = Literal["refuse", "stay"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinationOptions:
    """The same for every robot of the team.

    Attributes:
        order: ``fixed`` is the order of the team in every round; ``random`` draws one a round.
        seed: Seed of the random order; every robot derives the same orders from it.
        turns: Whether robots answer one after the other; otherwise all answer at the same moment.
        use_basis: Whether the basis of an announcement decides on its acceptance. Without it two
            robots that answer at the same moment can swap for ever.
        check_values: Whether a rise of the common objective is an error. Switch it off for an
            evaluator that is not exact.
        tolerance: A robot announces only if the objective falls by more than this, relative.
        choose: Whether to let an evaluator that can choose by bounds do so.
        without_path: A robot without a candidate path is an error, or it stays at its start.
        max_turns: Turns after which the team gives up.
        repair_after_s: Seconds of silence after which a robot asks for what it misses.
        lost_after_s: A robot that has not been heard of for so many seconds counts as lost: the
            others take their turns without it until it is back. Infinite: they wait for it.
        hung_after_s: The same where the network still sees the robot but it has said nothing for so
            many seconds, as when its program hangs; longer than the longest evaluation, in which a
            robot says nothing either. Infinite: the network is believed.
        drop_after_s: Seconds after which the path of a lost robot is withdrawn. Infinite: it is
            kept.
        time_limit_s: Seconds on the transport's clock after which the team gives up.
        session: Number of the planning session; a new one where a transport is used again, so that
            late copies of old messages are known for what they are.
    """

    order: Order = "fixed"
    seed: int = 0
    turns: bool = True
    use_basis: bool = True
    check_values: bool = True
    tolerance: float = 1e-6
    choose: bool = True
    without_path: WithoutPath = "refuse"
    max_turns: int = 10_000
    repair_after_s: float = 1.0
    lost_after_s: float = math.inf
    hung_after_s: float = math.inf
    drop_after_s: float = math.inf
    time_limit_s: float = 3600.0
    session: int = 0

    def __post_init__(self) -> None:
        """Check names and numbers."""
        if self.order not in ("fixed", "random"):
            raise InvalidInputError(
                f"coordination order: expected 'fixed' or 'random', got {self.order!r}"
            )
        if self.without_path not in ("refuse", "stay"):
            raise InvalidInputError(
                f"coordination without_path: expected 'refuse' or 'stay', got {self.without_path!r}"
            )
        check_not_negative(self.tolerance, "coordination tolerance")
        check_not_negative(self.seed, "coordination seed")
        check_not_negative(self.session, "coordination session")
        check_positive(self.max_turns, "coordination max_turns")
        check_positive(self.repair_after_s, "coordination repair_after_s")
        check_positive(self.time_limit_s, "coordination time_limit_s")
        if not self.lost_after_s >= 4.0 * self.repair_after_s:
            raise InvalidInputError(
                "coordination lost_after_s: expected at least four times repair_after_s = "
                f"{self.repair_after_s:g}, got {self.lost_after_s!r}"
            )
        for name in ("hung_after_s", "drop_after_s"):
            if not getattr(self, name) >= self.lost_after_s:
                raise InvalidInputError(
                    f"coordination {name}: expected at least lost_after_s = "
                    f"{self.lost_after_s:g}, got {getattr(self, name)!r}"
                )
        if self.lost_after_s < math.inf and not self.turns:
            raise InvalidInputError(
                "coordination lost_after_s: expected infinite where all answer at the same moment; "
                "only turns can be taken without a lost robot: turns=True"
            )
        if self.turns and not self.use_basis:
            raise InvalidInputError(
                "coordination use_basis: turns need no basis to be safe, but nothing is gained "
                "without it; use_basis=False is for turns=False"
            )
