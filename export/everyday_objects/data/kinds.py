"""All kinds of objects that the default model knows."""

from export.everyday_objects.data.makers import animals, creatures, furniture, household, outdoors, vehicles

KINDS = (
    *furniture.KINDS,
    *vehicles.KINDS,
    *animals.KINDS,
    *creatures.KINDS,
    *outdoors.KINDS,
    *household.KINDS,
)
BY_WORD = {kind.words[0]: kind for kind in KINDS}
