#!/usr/bin/env bash
# Installs what this package needs beside a Rust toolchain: OpenMPI and, for the bindings, libclang. Debian and Ubuntu; as root
# or with sudo. Says what is missing and fails where it cannot.
set -euo pipefail

missing=()
for package in libopenmpi-dev openmpi-bin libclang-dev; do
    dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
[ "${#missing[@]}" -gt 0 ] || exit 0

if ! command -v apt-get >/dev/null; then
    echo "install these by hand, there is no apt-get: ${missing[*]}" >&2
    exit 1
fi
root=()
if [ "$(id -u)" -ne 0 ]; then
    root=(sudo)
    sudo -n true 2>/dev/null || [ -t 0 ] || { echo "install these as root: ${missing[*]}" >&2; exit 1; }
fi
"${root[@]}" apt-get update -q
"${root[@]}" apt-get install -q -y --no-install-recommends "${missing[@]}"
