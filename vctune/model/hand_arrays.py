"""Several hands at once, and places in hands: hands whose numbers are arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vctune.model.hands import NAMES, Hand


def stacked(hands: Sequence[Hand], shape: tuple[int, ...] = (-1,)) -> Hand:
    """Return several hands as one whose numbers are arrays.

    Parameters
    ----------
    hands : of plain numbers
    shape : of the arrays
    """
    each = {name: np.array([getattr(hand, name) for hand in hands], float).reshape(shape) for name in NAMES}
    return Hand(**each)


@dataclass(frozen=True, slots=True)
class PlacesInHands:
    """Frequencies or angles, each with the hand in which it is met; arrays of one shape.

    Attributes
    ----------
    at : omega, rad/s, or theta = omega T, rad
    hands : numbers of the same shape
    """

    at: Any
    hands: Hand

    def __len__(self) -> int:
        return int(self.at.shape[-1])

    def mapped(self, of: Callable[..., Any], *others: PlacesInHands) -> PlacesInHands:
        """Return the places of a function of the frequencies, and of each number of the hands.

        Parameters
        ----------
        of : takes as many arrays as there are places
        others : more places
        """
        hands = self.hands.mapped(of, *(each.hands for each in others))
        return PlacesInHands(of(self.at, *(each.at for each in others)), hands)

    def __getitem__(self, index: Any) -> PlacesInHands:
        return self.mapped(lambda numbers: numbers[index])

    def joined(self, *more: PlacesInHands) -> PlacesInHands:
        """Return these places and others."""
        return self.mapped(lambda *each: np.concatenate(each, axis=-1), *more)

    @property
    def unique(self) -> PlacesInHands:
        """Each place once, in order."""
        rows = np.unique(np.vstack((self.at, *self.hands.numbers.values())), axis=1)
        at, *numbers = rows
        return PlacesInHands(at, Hand(*numbers))

    @classmethod
    def of(cls, places: Sequence[tuple[float, Hand]]) -> PlacesInHands:
        """Return places one after another."""
        return cls(np.array([at for at, _ in places], float), stacked([hand for _, hand in places]))
