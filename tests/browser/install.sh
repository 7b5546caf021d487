#!/usr/bin/env bash
# Brings what the tests of the page need, once: Chromium by apt, where we are root, and axe-core, which checks
# accessibility, by npm into a cache outside the tree. Exit code: 0 all is there, 1 something is missing (said which).
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

if ! command -v chromium >/dev/null && ! command -v chromium-browser >/dev/null; then
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "browser: apt installs chromium"
    { apt-get update -q && apt-get install -qy --no-install-recommends chromium fonts-dejavu-core; } \
      >"$cache/apt.log" 2>&1 || lacks chromium "apt could not install it: $cache/apt.log"
  else
    lacks chromium "apt install chromium"
  fi
fi

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
