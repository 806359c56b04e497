"""3MF, what slicers read: the 3MF core specification 1.3 and the colours of its materials extension."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float

from pipeline.formats.archive import zipped
from pipeline.mesh.mesh import Mesh

TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""


def threemf_bytes(mesh: Mesh, colours: Float[np.ndarray, "v 3"], name: str) -> bytes:
    """Return a 3MF file of a solid in millimetres, +Z up, with an sRGB colour in [0, 1] at every vertex."""
    shades, which = np.unique(np.rint(255 * colours).astype(np.int64), axis=0, return_inverse=True)
    which = which.reshape(-1)
    rows = np.concatenate([mesh.faces, which[mesh.faces]], axis=1).tolist()
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02">',
        "<resources>",
        '<m:colorgroup id="1">',
        *(f'<m:color color="#{red:02X}{green:02X}{blue:02X}"/>' for red, green, blue in shades.tolist()),
        "</m:colorgroup>",
        f'<object id="2" name={quoteattr(name)} type="model" pid="1" pindex="0"><mesh><vertices>',
        *(f'<vertex x="{x:.6g}" y="{y:.6g}" z="{z:.6g}"/>' for x, y, z in mesh.vertices.tolist()),
        "</vertices><triangles>",
        *(
            f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="1" p1="{p}" p2="{q}" p3="{r}"/>'
            for a, b, c, p, q, r in rows
        ),
        "</triangles></mesh></object>",
        "</resources>",
        '<build><item objectid="2"/></build>',
        "</model>\n",
    ]
    files = [
        ("[Content_Types].xml", TYPES),
        ("_rels/.rels", RELATIONS),
        ("3D/3dmodel.model", "\n".join(lines)),
    ]
    return zipped([(path, text.encode("utf-8")) for path, text in files], compressed=True)
