"""Planned observations of many states in columns: no loop over objects after this one."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, IntArray, Key


class ObservationTable(NamedTuple):
    """Planned observations, by state.

    Attributes:
        pointer: Shape (A + 1,), where the observations of each of A states begin.
        landmark: Shape (M,), key of the landmark, unsigned as GTSAM's.
        sensor: Shape (M,), place in ``sensors``.
        noise: Shape (M,), place in ``noises``.
        sensors: Names of sensors.
        noises: Distinct covariances.
    """

    pointer: IntArray
    landmark: NDArray[np.uint64]
    sensor: IntArray
    noise: IntArray
    sensors: tuple[str, ...]
    noises: tuple[Covariance, ...]

    def landmarks(self) -> list[Key]:
        """Every landmark that is observed, once, ascending."""
        return [int(key) for key in np.unique(self.landmark)]

    def take(self, states: IntArray) -> "ObservationTable":
        """Observations of some of the states, in the order given."""
        counts = np.diff(self.pointer)[states]
        pointer = np.zeros(len(states) + 1, np.int64)
        np.cumsum(counts, out=pointer[1:])
        rows = np.repeat(self.pointer[states] - pointer[:-1], counts) + np.arange(pointer[-1])
        return self._replace(
            pointer=pointer,
            landmark=self.landmark[rows],
            sensor=self.sensor[rows],
            noise=self.noise[rows],
        )

    def marks(self) -> IntArray:
        """A number for what each state observes: the same for the same, 0 for nothing."""
        rows = np.column_stack([self.landmark.view(np.int64), self.sensor, self.noise])
        marks = np.zeros(len(self.pointer) - 1, np.int64)
        known: dict[bytes, int] = {}
        for state in np.flatnonzero(np.diff(self.pointer)).tolist():
            content = rows[self.pointer[state] : self.pointer[state + 1]].tobytes()
            marks[state] = known.setdefault(content, len(known) + 1)
        return marks

    def each(self) -> Iterator[tuple[int, Key, str, Covariance]]:
        """State, landmark, sensor and noise of every observation."""
        state = np.repeat(np.arange(len(self.pointer) - 1), np.diff(self.pointer))
        for at, key, sensor, noise in zip(
            state.tolist(),
            self.landmark.tolist(),
            self.sensor.tolist(),
            self.noise.tolist(),
            strict=True,
        ):
            yield at, key, self.sensors[sensor], self.noises[noise]


def observation_table(paths: Sequence[CandidatePath]) -> ObservationTable:
    """Lay out the observations of some paths.

    Args:
        paths: The paths.

    Returns:
        A table over the states 1 to L of all paths, one path after the other.
    """
    flat = [seen for path in paths for seen in path.observations]
    begin = np.cumsum([0, *(path.steps for path in paths)])
    counts = np.array([len(path.observations) for path in paths], np.int64)
    steps = np.array([seen.step for seen in flat], np.int64)
    state = np.repeat(begin[:-1], counts) + steps - 1
    pointer = np.zeros(int(begin[-1]) + 1, np.int64)
    np.cumsum(np.bincount(state, minlength=int(begin[-1])), out=pointer[1:])
    names = [seen.sensor for seen in flat]
    sensors = {name: place for place, name in enumerate(dict.fromkeys(names))}
    # most observations share the very array of their noise: its bytes are taken once
    which = np.array([id(seen.covariance) for seen in flat], np.int64)
    _, first, array = np.unique(which, return_index=True, return_inverse=True)
    noises: dict[bytes, int] = {}
    kept: list[Covariance] = []
    number = np.zeros(len(first), np.int64)
    for place, at in enumerate(first.tolist()):
        noise = np.asarray(flat[at].covariance)
        number[place] = noises.setdefault(bytes(noise.shape) + noise.tobytes(), len(kept))
        if number[place] == len(kept):
            kept.append(noise)
    return ObservationTable(
        pointer=pointer,
        landmark=np.array([seen.landmark for seen in flat], np.uint64),
        sensor=np.array([sensors[name] for name in names], np.int64),
        noise=number[array],
        sensors=tuple(sensors),
        noises=tuple(kept),
    )
