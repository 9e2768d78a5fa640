"""One BLAS thread while beliefs are evaluated.

The matrices of planning have a few hundred rows at most: a second BLAS thread never pays, and on a
machine with other work it waits for its core (measured: dpotri of 300 rows 2 ms with one thread,
1,500 ms with two). Evaluators hold BLAS to one thread while they work and leave it as it was.
"""

import functools
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import ThreadpoolController


@functools.cache
def _controller() -> ThreadpoolController:
    """Handle on the BLAS libraries of this process, found once (2 ms)."""
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread; also a decorator."""
    with _controller().limit(limits=1, user_api="blas"):
        yield
