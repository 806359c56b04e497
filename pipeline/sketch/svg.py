"""An SVG drawing as pixels, in a process that has little to lose.

resvg, which draws, is written for drawings that their owners made: nested ones overflow its stack, and
filters or embedded pictures take any amount of time and memory. So each drawing is checked and drawn in a
process of its own, `python -m pipeline.sketch.svg`: SVG in on its standard input, PNG out. Before it reads
anything, it gives up opening files and sets itself limits; whatever ends it is one line for the user.
"""

import re
import resource
import subprocess
import sys
from pathlib import Path
from xml.parsers import expat

import resvg_py

from pipeline.errors import InputError, one_line

DRAWINGS = (".png", ".svg")
"""Endings of drawings."""
PROCESSOR_SECONDS, WAITING_SECONDS = 10, 50
MEMORY = 1 << 30
"""Of address space [bytes]."""
MOST_DEPTH = 200
"""Elements around an element: drawing programs nest tens."""
MOST_ENTITIES = 1000
_NO_DRAWING = 3


def svg_to_png(path: Path, side: int) -> bytes:
    """Return the drawing as a PNG file, `side` pixels a side at most, with no fonts of this machine and no
    files beside the drawing: the same drawing gives the same picture.

    Raises:
        InputError: no SVG, a picture from another file, or nothing that can be drawn within the limits.
    """
    with path.open("rb") as drawing:
        process = subprocess.Popen(
            [sys.executable, "-m", "pipeline.sketch.svg", str(side)],
            stdin=drawing,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        try:
            picture, said = process.communicate(timeout=WAITING_SECONDS)
        except subprocess.TimeoutExpired:
            picture, said = b"", b""
        finally:
            process.kill()
            process.communicate()
    if process.returncode == 0 and picture:
        return picture
    if process.returncode == _NO_DRAWING and said:
        raise InputError(f"{path} {one_line(said.decode('utf-8', 'replace'))}")
    raise InputError(
        f"{path} cannot be drawn within {PROCESSOR_SECONDS} s and {MEMORY >> 20} MB: simplify it (filters, "
        "nested groups, embedded pictures), or export it as PNG"
    )


def fault(drawing: bytes) -> str:
    """Return what makes a drawing unfit to be drawn, as the end of a sentence; "" if nothing does."""
    parser = expat.ParserCreate()
    depth = entities = 0
    found = ""

    def start(element: str, attributes: dict[str, str]) -> None:
        nonlocal depth, found
        depth += 1
        if depth > MOST_DEPTH and not found:
            found = f"nests more than {MOST_DEPTH} elements, expected tens: ungroup them"
        if element.rpartition(":")[2] not in ("image", "feImage"):
            return
        for name, value in attributes.items():
            link = value.strip()
            if name.rpartition(":")[2] == "href" and link and not link.startswith(("#", "data:")):
                found = (
                    f"shows a picture from another file ({link[:57]!r}), which is not read: embed it in the "
                    "drawing, or draw its outline"
                )

    def end(element: str) -> None:
        nonlocal depth
        depth -= 1

    def entity(name: str, parameter: bool, value: str | None, *elsewhere: str | None) -> None:
        nonlocal entities, found
        entities += 1
        if value is None:
            found = f"takes its entity {name[:57]!r} from another file, which is not read: export it again"
        elif "&" in value or "%" in value or entities > MOST_ENTITIES:
            found = f"has entities made of entities ({name[:57]!r}): export it again, as plain SVG"

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(drawing, True)
    except expat.ExpatError as error:
        return found or f"is not a readable SVG drawing ({error}): export it again, as plain SVG"
    return found


def main(side: int) -> None:
    """Draw what comes on standard input, and end the process."""
    _limit()
    drawing = sys.stdin.buffer.read()
    said = fault(drawing)
    if not said:
        try:
            text = drawing.decode("utf-8").removeprefix("\ufeff")
            picture = resvg_py.svg_to_bytes(svg_string=text, width=side, height=side, skip_system_fonts=True)
            sys.stdout.buffer.write(bytes(picture))
        except ValueError as error:
            reason = re.sub(r"\s+", " ", str(error))[:200]
            said = f"is not a readable SVG drawing ({reason}): export it again, as plain SVG"
    if said:
        sys.stderr.write(said)
        sys.stderr.flush()
        sys.exit(_NO_DRAWING)


def _limit() -> None:
    """Take from this process what no drawing needs: time, memory, dumps and any other file."""
    limits = {
        resource.RLIMIT_CPU: PROCESSOR_SECONDS,
        resource.RLIMIT_AS: MEMORY,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_FSIZE: 1 << 26,
        resource.RLIMIT_NOFILE: 3,
    }
    for limit, value in limits.items():
        _, most = resource.getrlimit(limit)
        value = value if most == resource.RLIM_INFINITY else min(value, most)
        resource.setrlimit(limit, (value, value))


if __name__ == "__main__":
    main(int(sys.argv[1]))
