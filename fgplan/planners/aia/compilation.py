"""How the hot kernels are compiled.

Kernels that allocate nothing are compiled without numba's reference counts (``_nrt``): a tuple of
arrays otherwise costs two atomic operations an array each time one is taken out of it, which made
a node four times as dear (1.4 against 0.35 us for appending one, measured). Such a kernel must not
make or return an array, and assigns element by element.
"""

from typing import Any

import numba

UNCOUNTED: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
"""Options of ``numba.njit``."""

COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled; NUMBA_DISABLE_JIT=1 in the environment says no."""
