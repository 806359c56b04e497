"""Animals: toys on four stout legs, heads larger than life; feet at y = 0, facing +z, about 1.5 long."""

from export.everyday_objects.data.makers.animals import cats, dogs, farm, forest, horses, savanna

horse, zebra = horses.KINDS
dog, german_shepherd, fox = dogs.KINDS
cat, tiger, lion = cats.KINDS
pig, cow, sheep = farm.KINDS
deer, bear, rabbit, squirrel = forest.KINDS
giraffe, elephant = savanna.KINDS

# Seeds draw kinds by their place in this order: it stays.
KINDS = (
    horse,
    dog,
    german_shepherd,
    cat,
    deer,
    pig,
    giraffe,
    cow,
    elephant,
    lion,
    sheep,
    fox,
    bear,
    zebra,
    tiger,
    rabbit,
    squirrel,
)
