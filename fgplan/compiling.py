"""``njit`` whose cache on disk several processes may fill at once.

numba numbers the compiled variants of a function in an index file. Two processes that compile
different variants of one function at the same moment both take the next number: the index then
names one variant, and the file holds the code of the other, which is loaded without a word. Robots
as processes, workers of a sweep and parallel tests do just that from a fresh installation. Here
every reading and writing of that cache holds a lock of its folder.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache

try:
    import fcntl
except ImportError:  # Windows has none, and keeps numba's own behaviour
    fcntl = None  # type: ignore[assignment]

LOCK = "fgplan-kernels.lock"
"""File beside the cached kernels that is locked."""


def njit(**kwargs: Any) -> Callable[[Callable[..., Any]], Any]:  # noqa: ANN401 - numba's
    """``numba.njit`` with a locked cache.

    Args:
        **kwargs: Options of ``numba.njit``.

    Returns:
        The decorator.
    """

    def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - a dispatcher
        """The dispatcher, or the function itself where compiling is switched off."""
        dispatcher: Any = numba.njit(**kwargs)(function)
        if kwargs.get("cache") and hasattr(dispatcher, "enable_caching"):
            dispatcher._cache = _LockedCache(function)
        return dispatcher

    return compiled


class _LockedCache(FunctionCache):
    """Index and code of one function, read and written under the lock of their folder."""

    def _load_overload(self, sig: Any, target_context: Any) -> Any:  # noqa: ANN401
        """Index and code as one."""
        if not Path(self.cache_path).exists():
            return None
        with self._locked():
            return super()._load_overload(sig, target_context)

    def _save_overload(self, sig: Any, data: Any) -> None:  # noqa: ANN401
        """Index and code as one."""
        self._impl.locator.ensure_cache_path()
        with self._locked():
            super()._save_overload(sig, data)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Hold the lock; it goes with the process, however that ends."""
        if fcntl is None:
            yield
            return
        try:
            file = (Path(self.cache_path) / LOCK).open("ab")
        except OSError:  # read-only: nobody writes there
            yield
            return
        with file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
