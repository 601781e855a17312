#!/usr/bin/env bash
# Installs what the named boards need on Debian, and nothing that is there: install.sh [BOARD…], of
# host mps2-an385 avr-uno nucleo-g474re fuzz; none: all boards. --check only says what is missing, exit code 1 then.
set -euo pipefail

check=false
[ "${1:-}" = --check ] && { check=true; shift; }
[ $# -gt 0 ] || set -- host mps2-an385 nucleo-g474re avr-uno

missing=()
need() {  # program or file, its package
  command -v "$1" >/dev/null || [ -e "$1" ] || missing+=("$2")
}

for board in "$@"; do
  need make make
  case $board in
    host) need gcc gcc; need gcov gcc; need /usr/include/stdio.h libc6-dev; need setpriv util-linux ;;
    mps2-an385) need arm-none-eabi-gcc gcc-arm-none-eabi; need qemu-system-arm qemu-system-arm ;;
    nucleo-g474re) need arm-none-eabi-gcc gcc-arm-none-eabi ;;
    avr-uno)
      need avr-gcc gcc-avr; need /usr/lib/avr/include/avr/io.h avr-libc
      need gcc gcc; need /usr/include/stdio.h libc6-dev
      need /usr/include/simavr/sim_avr.h libsimavr-dev ;;
    fuzz) need clang clang; need /usr/include/stdio.h libc6-dev ;;
    *) echo "install: no such board: $board" >&2; exit 2 ;;
  esac
done

[ ${#missing[@]} -gt 0 ] || exit 0
mapfile -t missing < <(printf '%s\n' "${missing[@]}" | sort -u)
if $check; then echo "missing: ${missing[*]}" >&2; exit 1; fi
command -v apt-get >/dev/null || { echo "install: please install: ${missing[*]}" >&2; exit 1; }
if [ "$(id -u)" = 0 ]; then as_root=env
elif command -v sudo >/dev/null; then as_root=sudo
else echo "install: needs root for: apt-get install ${missing[*]}" >&2; exit 1; fi
lock=(-o DPkg::Lock::Timeout=300)
$as_root apt-get "${lock[@]}" update -q
$as_root env DEBIAN_FRONTEND=noninteractive apt-get "${lock[@]}" install -y -q --no-install-recommends "${missing[@]}"
