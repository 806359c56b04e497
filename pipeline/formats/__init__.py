"""The asset in other files than GLB and OBJ: for scanners' tools, printers and Apple's viewers."""
