"""Vehicles as a toy shop has them: short, thick, big wheels, big windows."""

from export.everyday_objects.data.makers.vehicles import (
    aircraft,
    cars,
    heavy,
    lorries,
    motorbikes,
    ships,
    trains,
)

tractor, tank = heavy.KINDS
airplane, helicopter, rocket = aircraft.KINDS

# Seeds draw kinds by their place in this order: it stays.
KINDS = (
    *cars.KINDS,
    *lorries.KINDS,
    tractor,
    *motorbikes.KINDS,
    *trains.KINDS,
    airplane,
    helicopter,
    *ships.KINDS,
    rocket,
    tank,
)
