"""Food, things of the house, things to wear, to play and to carry."""

from export.everyday_objects.data.makers.household import (
    balls,
    devices,
    footwear,
    fruit,
    gifts,
    headwear,
    instruments,
    luggage,
    meals,
    sweets,
    vessels,
)

hamburger, pizza = meals.KINDS
suitcase, backpack, umbrella = luggage.KINDS

# Seeds draw kinds by their place in this order: it stays.
KINDS = (
    hamburger,
    *sweets.KINDS,
    pizza,
    *fruit.KINDS,
    *vessels.KINDS,
    *instruments.KINDS,
    suitcase,
    backpack,
    *footwear.KINDS,
    *headwear.KINDS,
    *balls.KINDS,
    *devices.KINDS,
    umbrella,
    *gifts.KINDS,
)
