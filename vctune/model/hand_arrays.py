"""Put several hands into one object: a hand whose numbers are arrays, or frequencies paired with hands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vctune.model.hands import NAMES, Hand


def stacked(hands: Sequence[Hand], shape: tuple[int, ...] = (-1,)) -> Hand:
    """Return several hands as one hand whose numbers are arrays."""
    each = {name: np.array([getattr(hand, name) for hand in hands], float).reshape(shape) for name in NAMES}
    return Hand(**each)


@dataclass(frozen=True, slots=True)
class PlacesInHands:
    """Frequencies or angles, each paired with a hand, as arrays of one shape."""

    at: Any  # omega, rad/s, or theta = omega T, rad
    hands: Hand  # hand whose numbers are arrays of the same shape

    def __len__(self) -> int:
        return int(self.at.shape[-1])

    def mapped(self, of: Callable[..., Any], *others: PlacesInHands) -> PlacesInHands:
        """Apply a function to `at` and to each number of the hands, and return the results as places."""
        hands = self.hands.mapped(of, *(each.hands for each in others))
        return PlacesInHands(of(self.at, *(each.at for each in others)), hands)

    def __getitem__(self, index: Any) -> PlacesInHands:
        return self.mapped(lambda numbers: numbers[index])

    def joined(self, *more: PlacesInHands) -> PlacesInHands:
        """Return these places, followed by other places."""
        return self.mapped(lambda *each: np.concatenate(each, axis=-1), *more)

    @property
    def unique(self) -> PlacesInHands:
        """The places of shape (n,) without duplicates, sorted by `at` and then by the numbers of the hands."""
        rows = np.unique(np.vstack((self.at, *self.hands.numbers.values())), axis=1)
        at, *numbers = rows
        return PlacesInHands(at, Hand(*numbers))

    @classmethod
    def of(cls, places: Sequence[tuple[float, Hand]]) -> PlacesInHands:
        """Return places of shape (n,), made from n pairs (frequency or angle, hand)."""
        return cls(np.array([at for at, _ in places], float), stacked([hand for _, hand in places]))
