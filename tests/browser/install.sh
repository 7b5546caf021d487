#!/usr/bin/env bash
# Brings what the tests of the page need, once: Chromium, ustreamer and a compiler (for its test picture) by apt, where we
# are root, and axe-core, which checks accessibility, by npm into a cache outside the tree. Exit code: 0 all is there,
# 1 something is missing (said which).
set -uo pipefail
cache="${YAHBOOMD_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/yahboomd}/browser"
axe="axe-core@4.10.3"
mkdir -p "$cache"
exec 9>"$cache/lock" && flock 9
missing=0

lacks() { # name, reason
  missing=1
  printf 'browser: NOT there: %s: %s\n' "$1" "$2"
}

from_apt() { # program, packages
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "browser: apt installs $1"
    { apt-get update -q && apt-get install -qy --no-install-recommends "${@:2}"; } \
      >"$cache/apt.log" 2>&1 || lacks "$1" "apt could not install it: $cache/apt.log"
  else
    lacks "$1" "apt install $1"
  fi
}

if ! command -v chromium >/dev/null && ! command -v chromium-browser >/dev/null; then
  from_apt chromium chromium fonts-dejavu-core
fi
command -v ustreamer >/dev/null || from_apt ustreamer ustreamer
command -v gcc >/dev/null || from_apt gcc gcc libc6-dev

if [ "$(cat "$cache/axe/.version" 2>/dev/null)" != "$axe" ]; then
  rm -rf "$cache/axe" && mkdir -p "$cache/axe"
  if ! command -v npm >/dev/null; then
    lacks axe-core "npm brings it (Debian: apt install npm)"
  elif (cd "$cache/axe" && npm pack --silent "$axe" && tar -xzf ./*.tgz --strip-components=1 package/axe.min.js) \
    >"$cache/npm.log" 2>&1; then
    rm -f "$cache"/axe/*.tgz
    echo "$axe" >"$cache/axe/.version"
  else
    lacks axe-core "npm could not fetch it: $cache/npm.log"
  fi
fi
exit "$missing"
