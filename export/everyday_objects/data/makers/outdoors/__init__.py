"""What stands outdoors: houses and castles, trees and plants, street furniture."""

from export.everyday_objects.data.makers.outdoors import (
    castles,
    houses,
    plants,
    shelters,
    street,
    temples,
    towers,
    trees,
)

castle, sandcastle = castles.KINDS
temple, pagoda = temples.KINDS

# Seeds draw kinds by their place in this order: it stays.
KINDS = (
    *houses.KINDS,
    castle,
    temple,
    sandcastle,
    pagoda,
    *towers.KINDS,
    *shelters.KINDS,
    *trees.KINDS,
    *plants.KINDS,
    *street.KINDS,
)
