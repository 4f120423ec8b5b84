"""The passive wheel on rough ground stops as often as its return map predicts."""

import math

import pytest

from scripts.studies.terrain import PASSIVE, first_passage, passive_walks


def test_the_passive_wheel_stops_after_as_many_steps_as_its_return_map_gives() -> None:
    roughness = math.radians(3)
    total, stops = passive_walks(roughness, stops=200, most_steps=100_000)
    error = total / stops**1.5
    assert total / stops == pytest.approx(first_passage(PASSIVE, roughness), abs=3 * error)
