"""Where messages live: flat arrays, one message after the other."""

from typing import NamedTuple

from fgplan.typing import BoolArray, FloatArray, IntArray


class MessagePool(NamedTuple):
    """Messages of n candidates; a tuple, because compiled code takes it as it is.

    A message has one slot for each interface variable, and rows of measurements for each slot.

    Attributes:
        candidates: Shape (n,), whose message stands at each place, where it is live.
        live: Shape (n,), whether it still holds.
        slot_pointer: Shape (n + 1,), where the slots of each message begin.
        noise_pointer: Shape (n + 1,), where N of each message begins.
        row_pointer: Shape (n + 1,), where its rows of T and G' begin.
        slot_variable: Shape (slots,), variable of each slot.
        slot_row: Shape (slots,), its first row within the message.
        slot_rank: Shape (slots,), its number of rows.
        slot_c: Shape (slots, d, d), its C; the identity where the rank is full.
        noise: N of each message as (rows, rows), lower triangle.
        response: T, shape (all rows, d).
        read_noise: G', shape (all rows, p d).
        read_response: Theta_s, shape (n, p d, d).
        read_covariance: E_ss, shape (n, p d, p d).
        row_count: Shape (n,), rows of each message.
        sound: Shape (n,), 1 where no digits were lost.
    """

    candidates: IntArray
    live: BoolArray
    slot_pointer: IntArray
    noise_pointer: IntArray
    row_pointer: IntArray
    slot_variable: IntArray
    slot_row: IntArray
    slot_rank: IntArray
    slot_c: FloatArray
    noise: FloatArray
    response: FloatArray
    read_noise: FloatArray
    read_response: FloatArray
    read_covariance: FloatArray
    row_count: IntArray
    sound: IntArray

    @property
    def bytes(self) -> int:
        """Memory held."""
        return sum(int(array.nbytes) for array in self)
