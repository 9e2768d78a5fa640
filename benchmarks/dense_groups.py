"""Groups of a tree's nodes, V_k, and the density f_V (8) that one is drawn from."""

import numpy as np

MOST_TRIES = 64


class DenseGroups:
    """Nodes by where their robots are, and which groups hold a node of greatest depth.

    ``members`` are the nodes of each group, ``poses`` where their robots are, ``keys`` the same as
    a key, ``stamp`` the depth at which a group was last entered into ``deepest``.
    """

    def __init__(self) -> None:
        """No group."""
        self.known: dict = {}
        self.members: list[list[int]] = []
        self.poses: list[np.ndarray] = []
        self.keys: list[tuple] = []
        self.stamp: list[int] = []
        self.deepest: list[int] = []
        self.depth = 0

    def enter(self, number: int, key: tuple, poses: np.ndarray, depth: int) -> int:
        """Enter a node; its group."""
        k = self.known.get(key)
        if k is None:
            k = self.known[key] = len(self.members)
            self.members.append([])
            self.poses.append(poses)
            self.keys.append(key)
            self.stamp.append(-1)
        self.members[k].append(number)
        if depth > self.depth:
            self.depth, self.deepest = depth, []
        if depth == self.depth and self.stamp[k] != depth:
            self.stamp[k] = depth
            self.deepest.append(k)
        return k

    def draw(self, generator: np.random.Generator, p_group: float, *, uniform: bool) -> int:
        """Equation (8), or uniform over the groups."""
        random, groups, deep = generator.random, len(self.members), len(self.deepest)
        if uniform:
            return int(random() * groups)
        biased = random() < p_group
        if biased or groups == deep:
            return self.deepest[int(random() * deep)]
        for _ in range(MOST_TRIES):
            k = int(random() * groups)
            if self.stamp[k] != self.depth:
                return k
        others = [k for k in range(groups) if self.stamp[k] != self.depth]
        return others[int(random() * len(others))]
