#!/usr/bin/env bash
# Makes the root file system of the system test's guest, once, in two stages that are kept for as long as nothing of theirs
# changes: Debian with a PREEMPT_RT kernel, systemd, sudo, can-utils and a user `lab` who may sudo; and on it hapticd's
# dependencies (not hapticd) in /opt/hapticd.
#
#   tests/system/image.sh CACHE    prints the folder of the root file system
set -euo pipefail
cd "$(dirname "$0")/../.."
cache=$1
mirror=${DEBIAN_MIRROR:-http://deb.debian.org/debian}
suite=bookworm
packages=linux-image-rt-amd64,systemd,systemd-sysv,udev,dbus,sudo,python3,python3-venv,can-utils,iproute2,kmod,procps,make,man-db

key() { sha256sum | cut -c1-16; }

requirements() {
  python3 -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb")); print("\n".join(p["project"]["dependencies"]))'
}

make_debian() {
  debootstrap --variant=minbase --include="$packages" "$suite" "$1" "$mirror"
  # The guest's disk is memory (an NVDIMM): the drivers must be there before the root file system is.
  printf '%s\n' nfit nd_pmem >> "$1/etc/initramfs-tools/modules"
  chroot "$1" update-initramfs -u
  rm -f "$1"/var/cache/apt/archives/*.deb
  chroot "$1" useradd --create-home --shell /bin/bash lab
  echo 'lab ALL=(ALL) NOPASSWD: ALL' > "$1/etc/sudoers.d/lab"
  echo hapticd-guest > "$1/etc/hostname"
  echo '127.0.0.1 localhost hapticd-guest' > "$1/etc/hosts"
  echo '/dev/pmem0 / ext4 defaults 0 1' > "$1/etc/fstab"
}

make_root() {
  cp -a --reflink=auto "$debian/." "$1"
  requirements > "$1/root/requirements.txt"
  cp constraints.txt "$1/root/"
  # The wheels are fetched by this machine's pip, with its settings, and installed in the guest without an index.
  .venv/bin/python -m pip download -qq --disable-pip-version-check --only-binary :all: --python-version 3.11 \
    --dest "$1/root/wheels" -r "$1/root/requirements.txt" -c constraints.txt 'setuptools>=77' wheel
  chroot "$1" python3 -m venv /opt/hapticd
  chroot "$1" /opt/hapticd/bin/python -m pip install -qq --disable-pip-version-check --no-index \
    --find-links /root/wheels -r /root/requirements.txt setuptools wheel
  rm -rf "$1/root/wheels"
}

keep() {
  # keep KIND FOLDER: make it unless it is there whole; others of its kind are out of date
  [ -e "$2/.done" ] && return
  rm -rf "$cache/$1"-*
  mkdir -p "$2"
  "make_$1" "$2" >&2
  touch "$2/.done"
}

debian=$cache/debian-$(key < "$0")
root=$cache/root-$({ cat "$0" constraints.txt; requirements; } | key)
keep debian "$debian"
keep root "$root"
echo "$root"
