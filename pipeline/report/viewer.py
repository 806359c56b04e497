"""The interactive viewer of the pages: three.js, which trimesh ships, and the script of ours beside it.

Nothing is fetched: a page holds both as text. `tests/server/test_browser.py` opens it in a browser.
"""

import base64
import functools
import hashlib
import io
import zipfile
from pathlib import Path

from trimesh import resources

SCRIPT = Path(__file__).with_name("viewer.js")
_ARCHIVE, _MEMBER = "templates/viewer.zip", "viewer.html.template"
_BEGIN, _END = "<script>", "THREE.GLTFLoader=GLTFLoader;})();"


@functools.cache
def three_js() -> str:
    """Return three.js with its loader of glTF as one script, the copyright notice first (MIT).

    Raises:
        RuntimeError: this version of trimesh ships it in another form.
    """
    with zipfile.ZipFile(io.BytesIO(resources.get_bytes(_ARCHIVE))) as archive:
        text = archive.read(_MEMBER).decode("utf-8")
    begin, end = text.find(_BEGIN), text.find(_END)
    if begin < 0 or end < 0:
        raise RuntimeError("trimesh ships three.js in another form: see pipeline/report/viewer.py")
    return text[begin + len(_BEGIN) : end + len(_END)]


@functools.cache
def viewer_js() -> str:
    """Return the viewer: `showAsset(host, bytes)`, which fills an element of a page."""
    return SCRIPT.read_text(encoding="utf-8")


def scripts() -> list[str]:
    """Return the scripts that a page needs before it calls `showAsset`, in their order."""
    return [three_js(), viewer_js()]


def inline(script: str) -> str:
    """Return a script as an element of a page."""
    if "</script" in script.lower():
        raise ValueError("a script that holds </script would end early")
    return f"<script>{script}</script>"


def policy(scripts: list[str]) -> str:
    """Return the content security policy of a page: nothing is fetched, and only these scripts run."""
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
        for script in scripts
    )
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "media-src data:; connect-src data: blob:; base-uri 'none'; form-action 'none'"
    )
