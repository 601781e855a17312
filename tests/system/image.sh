#!/usr/bin/env bash
# Makes the root file system of the system test's guest, once: Debian with a PREEMPT_RT kernel, systemd and can-utils, and
# hapticd's dependencies (not hapticd) in /opt/hapticd. Kept for as long as this script and the dependencies stay the same.
#
#   tests/system/image.sh CACHE    prints the folder of the root file system
set -euo pipefail
cd "$(dirname "$0")/../.."
cache=$1
mirror=${DEBIAN_MIRROR:-http://deb.debian.org/debian}
suite=bookworm
packages=linux-image-rt-amd64,systemd,systemd-sysv,udev,dbus,python3,python3-venv,can-utils,iproute2,kmod,procps,make,man-db

key=$(cat "$0" constraints.txt pyproject.toml | sha256sum | cut -c1-16)
root=$cache/$key
if [ ! -e "$root/.done" ]; then
  rm -rf "$cache"
  mkdir -p "$root"
  debootstrap --variant=minbase --include="$packages" "$suite" "$root" "$mirror" >&2
  # The wheels are fetched by this machine's pip, with its settings, and installed in the guest without an index.
  python3 -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb")); print("\n".join(p["project"]["dependencies"]))' \
    > "$root/root/requirements.txt"
  cp constraints.txt "$root/root/"
  .venv/bin/python -m pip download --quiet --disable-pip-version-check --only-binary :all: --python-version 3.11 \
    --dest "$root/root/wheels" -r "$root/root/requirements.txt" -c constraints.txt 'setuptools>=77' wheel >&2
  chroot "$root" python3 -m venv /opt/hapticd >&2
  chroot "$root" /opt/hapticd/bin/python -m pip install --quiet --disable-pip-version-check --no-index \
    --find-links /root/wheels -r /root/requirements.txt setuptools wheel >&2
  rm -rf "$root/root/wheels" "$root"/var/cache/apt/archives/*.deb
  echo hapticd-guest > "$root/etc/hostname"
  echo '/dev/vda / ext4 defaults 0 1' > "$root/etc/fstab"
  touch "$root/.done"
fi
echo "$root"
