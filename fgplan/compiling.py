"""``njit`` whose kernels several processes may compile at once, each kernel but once.

numba numbers the compiled variants of a function in an index file. Two processes that compile
different variants of one function at the same moment both take the next number: the index then
names one variant, and the file holds the code of the other, which is loaded without a word. Robots
as processes, workers of a sweep and parallel tests do just that from a fresh installation. Here
every reading and writing of that cache holds a lock of its folder.

They also compile the same kernels at the same moment. Here who compiles a kernel holds a lock of
it, and the others wait and load what comes. Processes cannot wait for each other in a ring, as
kernels do not call each other in one; nor does anybody wait for ever: after ``PATIENCE_S`` one
compiles for oneself, which costs time and nothing else.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.compiler_lock import global_compiler_lock

try:
    import fcntl
except ImportError:  # Windows has none, and keeps numba's own behaviour
    fcntl = None  # type: ignore[assignment]

LOCK = "fgplan-kernels.lock"
"""File beside the cached kernels that is locked."""
PATIENCE_S = 60.0
"""How long a process waits for another that compiles what it needs."""
ASK_AGAIN_S = 0.02
"""How often it looks whether the other is done."""


def njit(*, inner: bool = False, **kwargs: Any) -> Callable[[Callable[..., Any]], Any]:  # noqa: ANN401 - numba's
    """``numba.njit`` with a locked cache.

    No wrapper for C callbacks is compiled (nothing here is one): a sixth of the time.

    Args:
        inner: Only other kernels call it: no wrapper for Python is compiled, which for a kernel of
            many arrays is a third of the time. A call from Python raises ``TypeError``.
        **kwargs: Options of ``numba.njit``.

    Returns:
        The decorator.
    """

    def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - a dispatcher
        """The dispatcher, or the function itself where compiling is switched off."""
        options = {**kwargs, "no_cfunc_wrapper": True, "no_cpython_wrapper": inner}
        dispatcher: Any = numba.njit(**options)(function)
        if not hasattr(dispatcher, "enable_caching"):
            return dispatcher
        if inner:
            _refuse_python(dispatcher)
        if kwargs.get("cache"):
            cache = _LockedCache(function)
            dispatcher._cache = cache
            dispatcher.compile = _compiling_once(dispatcher, cache)
        return dispatcher

    return compiled


def _refuse_python(dispatcher: Any) -> None:  # noqa: ANN401 - a dispatcher
    """Calls from Python find no compiled variant, and raise instead of compiling one."""

    def refuse(*_: object, **__: object) -> None:
        """A call from Python."""
        raise TypeError(
            f"{dispatcher.py_func.__qualname__}: expected a call from another kernel, got one from "
            "Python; take inner=True from its njit to call it from there"
        )

    dispatcher._insert = lambda *_, **__: None
    dispatcher._compile_for_args = refuse


def _compiling_once(dispatcher: Any, cache: "_LockedCache") -> Callable[[Any], Any]:  # noqa: ANN401
    """``dispatcher.compile``, after which the lock of its kernel is free again."""
    compile_it = dispatcher.compile

    def compile_once(signature: Any) -> Any:  # noqa: ANN401 - numba's
        """Compile a signature, or load what another process compiled meanwhile."""
        # The lock of this process's threads comes first, in every process: else one thread holds
        # it and wants the kernel, another holds the kernel and wants it.
        with global_compiler_lock:
            outermost = cache.lock is None  # one variant may ask for another
            try:
                return compile_it(signature)
            finally:
                if outermost:
                    cache.release()

    return compile_once


class _LockedCache(FunctionCache):
    """Index and code of one function, read and written under the lock of their folder."""

    lock: Any = None
    """The open file whose lock is this kernel's, while this process compiles it."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:  # noqa: ANN401
        """What is there; if nothing is, hold the kernel's lock and look again."""
        found = super().load_overload(sig, target_context)
        if found is not None or self.lock is not None:
            return found
        self.lock = self._open(f"{self._impl.filename_base}.lock")
        if self.lock is None:
            return None
        _wait_for(self.lock)
        return super().load_overload(sig, target_context)

    def release(self) -> None:
        """Give the kernel's lock back, if it is held."""
        if self.lock is not None:
            self.lock.close()
            self.lock = None

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
        """Hold the lock of the folder."""
        file = self._open(LOCK)
        if file is None:
            yield
            return
        with file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _open(self, name: str) -> Any:  # noqa: ANN401 - a file or None
        """A file to lock, or None; its lock goes with the process, however that ends."""
        if fcntl is None:
            return None
        with contextlib.suppress(OSError):  # read-only: nobody writes there
            self._impl.locator.ensure_cache_path()
            return (Path(self.cache_path) / name).open("ab")
        return None


def _wait_for(file: Any) -> None:  # noqa: ANN401 - an open file
    """Lock a file, or give up after ``PATIENCE_S``."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > end:
                return
            time.sleep(ASK_AGAIN_S)
        else:
            return
