"""What the incremental evaluator keeps from one announcement to the next, as a value.

Memory is a value: every evaluation takes one and returns a new one; nothing hides in a module or
an object. It can be dropped at any time and only costs time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fgplan.evaluation.incremental.candidate_table import CandidateTable
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.prior_marginal import PriorMarginal
from fgplan.evaluation.incremental.segments import Carried
from fgplan.evaluation.incremental.universe import InformationBlocks
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import BoolArray, Covariance, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """State of one robot's evaluator.

    Attributes:
        problem: Prior, team, objective and models.
        robot: Whose candidates these are.
        table: The candidates as arrays.
        wide: What one elimination of the history left.
        numbering: Numbers of variables.
        prior: Marginal of the touched prior variables.
        fixed: Factors of the own states with landmarks and past poses.
        prior_blocks: Prior covariance of the terms that compare with it.
        path_terms: Shape (N, T), terms of the candidates' own paths.
        announced: The others' paths at the last evaluation.
        own_pieces: By robot, its announced path and the blocks of its own factors.
        meetings: Blocks of the factors among the announced paths.
        moving: Factors of the own states with announced poses, at the last evaluation.
        pools: Messages that may be used again.
        terms: Shape (N, T), unweighted terms at the last evaluation; NaN where not evaluated.
        carried: Segments that an earlier planning session left.
        told: Shape (N,), candidates whose messages have been built, and whose segments counted.
    """

    problem: PlanningProblem
    robot: str
    table: CandidateTable
    wide: PriorMarginal
    numbering: Numbering
    prior: PriorMarginal
    fixed: FactorBlocks
    prior_blocks: Mapping[int, Covariance]
    path_terms: FloatArray
    announced: Mapping[str, CandidatePath] = field(default_factory=dict)
    own_pieces: Mapping[str, tuple[CandidatePath, InformationBlocks]] = field(default_factory=dict)
    meetings: InformationBlocks | None = None
    moving: FactorBlocks
    pools: tuple[MessagePool, ...] = ()
    terms: FloatArray | None = None
    carried: Carried | None = None
    told: BoolArray

    def pieces(self) -> list[InformationBlocks]:
        """Blocks of all factors of the others."""
        meetings = [] if self.meetings is None else [self.meetings]
        return [piece for _, piece in self.own_pieces.values()] + meetings

    @property
    def bytes(self) -> int:
        """Memory held for re-use."""
        return (
            sum(pool.bytes for pool in self.pools)
            + (0 if self.carried is None else self.carried.bytes)
            + sum(int(piece.blocks.nbytes) for piece in self.pieces())
            + self.moving.bytes
            + self.fixed.bytes
            + int(self.wide.rows.nbytes + self.prior.rows.nbytes)
            + sum(int(array.nbytes) for array in self.table.motion)
        )
