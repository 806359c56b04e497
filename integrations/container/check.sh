#!/bin/sh
# Makes a minimal Debian in a folder, with the packages that the Containerfile names and no others, and goes
# through the README's two commands in it. Needs root, mmdebstrap (apt-get install mmdebstrap) and a network.
#   sh integrations/container/check.sh folder [suite, bookworm if left out] [test: also the tests]
# PIP_CONFIG_FILE=file takes pip's settings along.
# BIND="folder ..." makes folders of this machine visible inside, read-only: a local package index, for example.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
folder=${1:?name a folder for the Debian}
suite=${2:-bookworm}
packages=$(sed -n '/apt-get install/,/&&/p' "$root/integrations/container/Containerfile" |
    sed -n 's/^    \([a-z0-9.+-]*\) \\$/\1/p' | paste -sd, -)

fail() { echo "error: $1" >&2; exit 2; }

[ "$(id -u)" = 0 ] || fail "this needs root"
command -v mmdebstrap >/dev/null || fail "there is no mmdebstrap: apt-get install mmdebstrap"
[ -e "$folder/etc/debian_version" ] || mmdebstrap --quiet --variant=minbase --include="$packages" "$suite" "$folder"
echo "Debian $(cat "$folder/etc/debian_version") with $packages: $(du -sxm "$folder" | cut -f1) MB"

rm -rf "$folder/project"
mkdir -p "$folder/project"
git -C "$root" archive HEAD | tar -x -C "$folder/project"

# In a mount namespace of its own, so that nothing stays mounted whatever happens.
unshare --mount --pid --fork sh -euc '
    folder=$1 goal=$2
    mount --make-rprivate /
    mount -t proc proc "$folder/proc"
    mount --rbind /dev "$folder/dev"
    for place in ${BIND:-}; do
        mkdir -p "$folder$place"
        mount --bind -o ro "$place" "$folder$place"
    done
    cp /etc/resolv.conf "$folder/etc/resolv.conf"
    [ -z "${PIP_CONFIG_FILE:-}" ] || cp "$PIP_CONFIG_FILE" "$folder/etc/pip.conf"
    [ ! -e /etc/ssl/certs/ca-certificates.crt ] || cp /etc/ssl/certs/ca-certificates.crt "$folder/etc/ssl/certs/"
    inside() { chroot "$folder" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 \
        ${OMP_NUM_THREADS:+OMP_NUM_THREADS=$OMP_NUM_THREADS} sh -euc "cd /project; $1"; }
    inside "make run PROMPT=\"a red armchair\" QUALITY=draft && make verify RUN=runs/latest && make doctor"
    [ "$goal" != test ] || inside "make test"
' sh "$folder" "${3:-}"
echo "two commands to an asset: $folder/project/runs/latest/asset.glb"
