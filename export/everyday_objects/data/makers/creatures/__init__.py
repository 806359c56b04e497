"""Toys and creatures: plump animals of the yard, the pond and the fairy tale, people, and hands."""

from export.everyday_objects.data.makers.creatures import (
    birds,
    fishes,
    garden,
    hands,
    monsters,
    people,
    pond,
    toys,
)

teddy_bear, lego_man, robot = toys.KINDS

# Seeds draw kinds by their place in this order: it stays.
KINDS = (
    teddy_bear,
    *birds.KINDS,
    *fishes.KINDS,
    *pond.KINDS,
    *monsters.KINDS,
    *garden.KINDS,
    lego_man,
    robot,
    *hands.KINDS,
    *people.KINDS,
)
