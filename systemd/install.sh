#!/usr/bin/env bash
# Installs hapticd for the whole machine: a virtual environment of its own under /opt, units, user, udev rules, completions
# and manual pages. Run again, it brings everything up to date; configurations and recordings are never touched.
#
#   systemd/install.sh            install or update (make install)
#   systemd/install.sh uninstall  take everything away but /etc/hapticd and /var/lib/hapticd (make uninstall)
#
# WHEEL=path installs that wheel instead of this source tree.
set -euo pipefail
cd "$(dirname "$0")/.."

prefix=/opt/hapticd
local=/usr/local
cache=/var/cache/hapticd
scope_cache=(/var/cache/hapticd-scope /var/cache/private/hapticd-scope)  # a link, and what it points to: DynamicUser=
units=(hapticd.service hapticd@.service hapticd-can0.service hapticd-metrics@.service hapticd-metrics@.timer hapticd-scope.service)

fail() { echo "install: $*" >&2; exit 1; }
say() { echo "install: $*"; }

[ "$(id -u)" = 0 ] || fail "needs root: sudo make ${1:-install}"

files() {
  # what goes where, besides the virtual environment: source, target
  local unit
  for unit in "${units[@]}"; do echo "systemd/$unit $local/lib/systemd/system/$unit"; done
  echo "systemd/hapticd.sysusers $local/lib/sysusers.d/hapticd.conf"
  echo "systemd/hapticd.tmpfiles $local/lib/tmpfiles.d/hapticd.conf"
  echo "systemd/60-hapticd.rules /etc/udev/rules.d/60-hapticd.rules"
}

with_systemd() { [ -d /run/systemd/system ]; }

reload() {
  if with_systemd; then systemctl daemon-reload; fi
  if [ -S /run/udev/control ]; then
    udevadm control --reload
    udevadm trigger --action=change --sysname-match=cpu_dma_latency || true
  fi
}

fill_cache() {
  # As the daemon's user, where the unit looks: with this, the first start does not compile for a minute.
  install -d -m 755 "$cache"
  chown -R hapticd:hapticd "$cache"
  say "compiling the servo loop into $cache (about a minute; what is there already is kept) …"
  (cd / && runuser -u hapticd -- env NUMBA_CACHE_DIR="$cache" "$prefix/bin/python" -m hapticd.service.precompile) |
    while read -r line; do say "  $line"; done
}

uninstall() {
  if with_systemd; then
    # Ours and the instances of our templates, and no other unit whose name begins like them.
    for unit in $(systemctl list-units --all --plain --no-legend "${units[@]/@./@*.}" | awk '{print $1}'); do
      systemctl disable --now "$unit" 2>/dev/null || systemctl stop "$unit" || true
    done
  fi
  files | while read -r _ target; do rm -f "$target"; done
  rm -rf "$prefix" "$cache" "${scope_cache[@]}" /run/hapticd
  find /var/log -maxdepth 1 \( -name hapticd -o -name 'hapticd-*' \) -type d -empty -delete
  rm -f "$local/bin/hapticd" "$local/share/bash-completion/completions/hapticd" \
    "$local/share/zsh/site-functions/_hapticd" "$local"/share/man/man1/hapticd.1 "$local"/share/man/man1/hapticd-*.1
  reload
  say "gone; configurations stay in /etc/hapticd, recordings in /var/lib/hapticd, the user hapticd owns them"
}

install_all() {
  python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "needs Python 3.11 or later"
  if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    env DEBIAN_FRONTEND=noninteractive apt-get update -q
    env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends python3-venv
  fi
  [ -x "$prefix/bin/python" ] || python3 -m venv "$prefix"
  say "hapticd and its dependencies into $prefix …"
  "$prefix/bin/python" -m pip install --quiet --disable-pip-version-check --constraint constraints.txt "${WHEEL:-.}"

  files | while read -r source target; do install -D -m 644 "$source" "$target"; done
  mkdir -p "$local/bin" "$local/share/bash-completion/completions" "$local/share/zsh/site-functions" "$local/share/man/man1"
  ln -sfn "$prefix/bin/hapticd" "$local/bin/hapticd"
  _HAPTICD_COMPLETE=source_bash "$prefix/bin/hapticd" > "$local/share/bash-completion/completions/hapticd"
  _HAPTICD_COMPLETE=source_zsh "$prefix/bin/hapticd" > "$local/share/zsh/site-functions/_hapticd"
  "$prefix/bin/python" -m hapticd.cli.man "$local/share/man/man1"

  systemd-sysusers "$local/lib/sysusers.d/hapticd.conf"
  systemd-tmpfiles --create "$local/lib/tmpfiles.d/hapticd.conf"
  if [ ! -e /etc/hapticd/hapticd.yaml ]; then
    "$prefix/bin/hapticd" config show > /etc/hapticd/hapticd.yaml.new
    sed -i -E '/^(record|api):/,$d' /etc/hapticd/hapticd.yaml.new  # places: the service's own
    chgrp hapticd /etc/hapticd/hapticd.yaml.new && chmod 640 /etc/hapticd/hapticd.yaml.new
    mv /etc/hapticd/hapticd.yaml.new /etc/hapticd/hapticd.yaml
    say "/etc/hapticd/hapticd.yaml is the simulated testbed; put your driver there"
  fi
  fill_cache
  reload
  say "done: systemctl enable --now hapticd; who is in the group hapticd may command it (adduser YOU hapticd)"
}

case "${1:-install}" in
  install) install_all ;;
  uninstall) uninstall ;;
  *) fail "unknown word $1 (install or uninstall)" ;;
esac
