"""Which catalogue models stand for which noun, and how freely each noun may be recoloured.

A row: the words a prompt may use (the first is the main one), a pattern over the whole catalogue name in
lower case, the share of its pictures that are recoloured, and the weight of the noun in the training mixture:
more for kinds of many shapes, which take longer to learn, and for what people ask for first.
"""

import re
from typing import NamedTuple


class Noun(NamedTuple):
    """One kind of object."""

    words: tuple[str, ...]
    pattern: str
    """Full match against the catalogue's name in lower case; empty for nouns that are only procedural."""
    recolour: float = 0.65
    weight: float = 1.0


NOUNS = (
    Noun(("chair",), r"((bar|cafe|children|folding|oak|osaka|plastic|teck|child|frame) )?chair"
         r"( with cushion)?", weight=2.0),
    Noun(("armchair",), r"((modern|rattan|winchester) )?armchair( ottoman)?", weight=2.5),
    Noun(("sofa", "couch"), r"((burlap|clear|corner|rattan|winchester) )?sofa( [23] seats)?|(futon )?couch",
         weight=4.5),
    Noun(("table",), r"((bar|cafe|oak|round|rattan|coffee|wooden|wooden alder|wooden teak|black|folding"
         r"|technical) )?table|table on trestles", weight=2.0),
    Noun(("desk",), r"(wooden )?desk( table)?", weight=1.0),
    Noun(("bed",), r"((child|hospital|iron|captain's) )?bed", weight=3.5),
    Noun(("bench",), r"((concrete|painted|piano|park) )?bench", weight=1.5),
    Noun(("stool",), r"(bar )?stool|puff", weight=0.8),
    Noun(("cabinet", "dresser"), r"((drawers|filing|high|glass door|sink) )?cabinet"
         r"|dresser with drawers|chest", weight=1.5),
    Noun(("bookcase", "bookshelf"), r"(full )?bookcase|(vertical )?shelves", weight=2.0),
    Noun(("lamp",), r"((desk|little|pedestal vase|camping) )?lamp", weight=1.2),
    Noun(("street lamp",), r"classic lamppost|street (lamp|light)|park light", weight=0.8),
    Noun(("car",), r"car model|concept sedan.*|ford focus|peugeot.*|chevrolet|seat leon|smart car"
         r"|vw new beetle|suv|renault scenic", weight=2.5),
    Noun(("truck",), r"truck", weight=3.0),
    Noun(("bus",), r"(city )?bus|van", weight=3.0),
    Noun(("piano",), r"(grand|upright) piano", weight=3.0),
    Noun(("guitar",), r"electric guitar", weight=1.5),
    Noun(("horse",), r"horse|rocking horse", 0.3, weight=2.0),
    Noun(("cat",), r"(siamese )?cat", 0.15, weight=1.5),
    Noun(("dog",), r"dog|bulldog", 0.15, weight=2.5),
    Noun(("rabbit",), r"rabbit", 0.15, weight=1.5),
    Noun(("teddy bear",), r"teddy bear", 0.5, weight=1.5),
    Noun(("plant", "potted plant"), r"(indoor |decorative |little |spider )?plant|ficus|yucca"
         r"|spathiphyllum|orchids", 0.1, 1.0),
    Noun(("tree",), r"copper beech|poplar|sycamore maple|japanese maple|acacia|bonsai tree", 0.05, 1.3),
    Noun(("palm tree",), r"palm tree|(bended )?coconut tree", 0.05, 0.6),
    Noun(("pine tree", "christmas tree"), r"pine.*|christmas tree|cypress|blue pine under snow", 0.05, 0.7),
    Noun(("cactus",), r"cactus", 0.1, 0.9),
    Noun(("bottle",), r"((beer|wine|spray|yogurt|baby) )?bottle", weight=0.8),
    Noun(("vase",), r"vase|pottery|old jar", weight=0.8),
    Noun(("teapot",), r"teapot|espresso kettle", weight=1.2),
    Noun(("mug", "cup"), r"cup|coffee (cup|mug)", weight=2.0),
    Noun(("hamburger",), r"hamburger", 0.02, 0.8),
    Noun(("cake",), r"(birthday |cup )cake", 0.25, 0.9),
    Noun(("snowman",), r"snowman", 0.02, 0.8),
    Noun(("fire hydrant",), r"fire hydrant", weight=2.0),
    Noun(("barrel",), r"barrel", weight=0.7),
    Noun(("box", "crate"), r"(cardboard |open cardboard )?box|crate", weight=1.8),
    Noun(("suitcase",), r"suitcase|briefcase", weight=2.2),
    Noun(("backpack",), r"backpack", weight=1.8),
    Noun(("boat",), r"rowboat", weight=2.2),
    Noun(("airplane",), r"biplane", weight=2.0),
    Noun(("fireplace",), r"fireplace", 0.3, 1.8),
    Noun(("dog house",), r"dog house|garden hut", weight=0.7),
    Noun(("house",), r"", weight=1.5),
    Noun(("mushroom",), r"", weight=0.6),
    Noun(("rocket",), r"", weight=0.8),
    Noun(("donut",), r"", weight=0.6),
    Noun(("duck",), r"", weight=1.2),
    Noun(("ball",), r"", weight=0.6),
    Noun(("ice cream",), r"", weight=1.0),
    Noun(("pumpkin",), r"", weight=0.5),
)  # fmt: skip


def noun_of(name: str) -> Noun | None:
    """Return the noun that a catalogue name belongs to, or None; the first row that matches wins."""
    return next((n for n in NOUNS if n.pattern and re.fullmatch(n.pattern, name.lower())), None)
