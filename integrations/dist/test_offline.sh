#!/bin/sh
# Installs build/dist (make it with `make dist`) where there is no network, and makes an asset.
#   sh integrations/dist/test_offline.sh [folder for the installation]
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
scratch=${1:-$(mktemp -d)}
[ -f "$root/build/dist/install.sh" ] || { echo "error: build/dist is not there: make dist" >&2; exit 2; }
user=$([ "$(id -u)" = 0 ] || echo --map-root-user)
unshare --net $user sh -euc '
    root=$1 scratch=$2
    ! getent hosts pypi.org >/dev/null 2>&1 || { echo "error: this still has a network" >&2; exit 1; }
    sh "$root/build/dist/install.sh" "$scratch/installed"
    cd "$scratch"
    export HOME="$scratch/home" && mkdir -p "$HOME"
    "$scratch/installed/bin/latent-nerf" models --verify
    "$scratch/installed/bin/latent-nerf" run "a red armchair" --quality draft | tail -n 1
    "$scratch/installed/bin/latent-nerf" verify runs/latest
' sh "$root" "$scratch"
echo "made without a network: $scratch/runs/latest/asset.glb"
