"""The table of parts says of each part what its record, the device and the problem file have."""

from dataclasses import fields

import numpy as np
import pytest

from vctune.document.schema.device_schema import DeviceTable, ServoDeviceTable
from vctune.model.device import Device
from vctune.model.hand_arrays import PlacesInHands, stacked
from vctune.model.hands import HAND, Hand, Hands
from vctune.model.parts import DELAYS, NUMBERS, OF_FIRMWARE, PART_NUMBERS, PARTS, UNCERTAIN

NAMES = {field.name for field in fields(Device)}


@pytest.mark.parametrize("key", PARTS)
def test_each_part_is_a_field_of_its_device_and_a_table_of_the_file(key):
    part = PARTS[key]
    table = ServoDeviceTable if key == "servo" else DeviceTable
    known, record = table.model_fields, {field.name for field in fields(part.record)}
    assert key in NAMES and key in known
    assert {number.name for number in part.numbers} | {number.order_key for number in part.numbers} - {""} <= record
    assert part.ideal is None or part.ideal == part.record()


def test_each_number_is_of_the_firmware_or_of_the_device():
    assert set(NUMBERS) | set(OF_FIRMWARE) == set(PART_NUMBERS)
    assert set(UNCERTAIN) == set(NUMBERS) - {"sample_time"}
    assert [key for key in DELAYS if PART_NUMBERS[key].quantity != "time"] == []
    assert all(PART_NUMBERS[key].label for key in NUMBERS)


def test_a_hand_is_told_by_the_names_of_its_numbers():
    low, high = Hand(0.0, 1.0, 2.0), Hand(0.5, 1.0, 30.0)
    box = Hands(low, high)
    assert Hand.of(low.by_key) == low and tuple(low.by_key) == HAND
    assert set(box.corners) == {Hand(mass, 1.0, stiffness) for mass in (0.0, 0.5) for stiffness in (2.0, 30.0)}
    assert low.mapped(lambda a, b: (a + b) / 2, high) == box.middle


def test_places_in_hands_are_joined_sorted_and_taken_apart():
    hands = [Hand(0.5, 1.0, 30.0), Hand(0.0, 2.0, 2.0)]
    places = PlacesInHands.of([(3.0, hands[0]), (1.0, hands[1])])
    both = places.joined(places).unique
    assert len(places.joined(places)) == 4 and len(both) == 2
    assert [(both.at[k], both.hands.mapped(lambda x, k=k: x[k])) for k in (0, 1)] == [(1.0, hands[1]), (3.0, hands[0])]
    assert len(PlacesInHands.of(())) == 0
    assert stacked(hands, (-1, 1)).stiffness == pytest.approx(np.array([[30.0], [2.0]]))
