#!/usr/bin/env bash
# Makes the virtual environment that `make run` and `make test` use. On a Debian without python3-venv it installs that
# package first (as root, or through sudo).
set -euo pipefail
cd "$(dirname "$0")"
venv=${1:-.venv}
python=${PYTHON:-python3}

fail() { echo "install: $*" >&2; exit 1; }

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"
  elif command -v sudo >/dev/null; then sudo "$@"
  else fail "needs root for: $* (run it yourself, then try again)"; fi
}

debian_install() {
  command -v apt-get >/dev/null || fail "please install: $*"
  as_root env DEBIAN_FRONTEND=noninteractive apt-get update -q
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@"
}

command -v "$python" >/dev/null || debian_install python3
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
  || fail "needs Python 3.11 or later, found $("$python" -V 2>&1); choose another with PYTHON=python3.12 make …"
"$python" -c 'import ensurepip, venv' 2>/dev/null || debian_install python3-venv

[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
