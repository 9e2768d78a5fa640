"""What the environment says about threads of the linear algebra library.

Timings of small matrices depend on it: more than one thread makes them slower and noisier. A bench
reads the setting and says so; it does not change it, because the library has read it already.
"""

import os
from collections.abc import Mapping

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def blas_threads() -> dict[str, str | None]:
    """Value of each variable that sets the number of threads; None where it is not set."""
    return {name: os.environ.get(name) for name in VARIABLES}


def blas_warning(found: Mapping[str, str | None]) -> str | None:
    """A sentence where more than one thread may be active, else None.

    Args:
        found: From ``blas_threads``.

    Returns:
        The sentence. OpenBLAS, which the wheels of numpy and scipy bring, reads its own variable
        first and OMP_NUM_THREADS where that is not set.
    """
    threads = found["OPENBLAS_NUM_THREADS"] or found["OMP_NUM_THREADS"]
    if threads == "1":
        return None
    return (
        f"expected OPENBLAS_NUM_THREADS=1, got {threads or 'nothing set'}: more than one BLAS "
        "thread may be active and seconds are not comparable"
    )
