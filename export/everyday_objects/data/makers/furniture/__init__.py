"""Furniture and what stands about a house: seats, tables, beds, cupboards, pianos, containers."""

from export.everyday_objects.data.makers.furniture import (
    beds,
    containers,
    cupboards,
    hearth,
    pianos,
    seats,
    tables,
)

chair, armchair, sofa, bench, stool = seats.KINDS
lamp, fireplace = hearth.KINDS

# Seeds draw kinds by their place in this order: it stays.
KINDS = (
    chair,
    armchair,
    sofa,
    *tables.KINDS,
    *beds.KINDS,
    bench,
    stool,
    *cupboards.KINDS,
    lamp,
    *pianos.KINDS,
    fireplace,
    *containers.KINDS,
)
