#!/bin/sh
# Installs latent-nerf from this folder into one of yours, without a network:
#   sh install.sh [folder, ~/latent-nerf if left out]
# PYTHON=python3.11 chooses the interpreter, of the version that the folder was made with.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
folder=${1:-$HOME/latent-nerf}
python=${PYTHON:-python3}

fail() { echo "error: $1" >&2; exit 2; }

command -v "$python" >/dev/null 2>&1 || fail "there is no $python: install Python 3.11 or newer, or say PYTHON=path"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "$python is older than 3.11: say PYTHON=python3.11"
"$python" -c 'import venv, ensurepip' 2>/dev/null || fail "$python has no venv: install its package, on Debian python3-venv"
(cd "$here" && sha256sum --quiet --check SHA256SUMS) || fail "$here is damaged, see the lines above: copy it again"
[ ! -e "$folder" ] || [ -e "$folder/pyvenv.cfg" ] || fail "$folder exists and is no installation: choose another folder"

"$python" -m venv "$folder"
"$folder/bin/python" -m pip install --quiet --disable-pip-version-check --no-index --find-links "$here/wheels" \
    "latent-nerf-onnx[serve]" || fail "the wheels do not fit $("$python" -V), or the disk is full: see the lines above"
echo "installed; try: $folder/bin/latent-nerf run \"a red armchair\""
