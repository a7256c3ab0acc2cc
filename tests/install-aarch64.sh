#!/usr/bin/env bash
# What compiling and running tests for AArch64 needs beside the Rust target: a linker and an emulator. Does nothing where
# they are there; fails where they are not and cannot be installed.
set -euo pipefail

if command -v aarch64-linux-gnu-gcc >/dev/null && command -v qemu-aarch64 >/dev/null; then
    exit 0
fi
if ! command -v apt-get >/dev/null || [ "$(id -u)" -ne 0 ]; then
    echo "install gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user" >&2
    exit 1
fi
export DEBIAN_FRONTEND=noninteractive
apt-get -qq update
apt-get -qq install -y --no-install-recommends gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user >/dev/null
