#!/usr/bin/env bash
# Web pages and curl on this machine drive the robot, pages of other websites do not: http://127.0.0.1:8080
#
#   gateway.sh [GATEWAY.JSON5]     until Ctrl-C; PAGE is the folder of the page, ROBOT_PORT the port of yahboomd
#
# It needs zenohd with zenoh-plugin-remote-api and zenoh-plugin-rest, nginx and socat.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
config="$(realpath "${1:-$here/gateway.json5}")"
page="$(realpath "${PAGE:-$here/../typescript/dist}")" || exit 66
zenohd="${ZENOHD:-zenohd}"
PATH="$PATH:/usr/sbin:/sbin"
for program in "$zenohd" nginx socat ip unshare setpriv; do
  command -v "$program" >/dev/null || { echo "gateway: there is no $program here. Install it." >&2; exit 69; }
done

# A folder that only this user enters: it has the sockets between the two networks.
run="$(mktemp -d "${XDG_RUNTIME_DIR:-/tmp}/yahboomd-web.XXXXXX")"
cd "$run"
mkdir tmp
ln -s "$page" page
trap 'rm -rf "$run"' EXIT
trap 'exit 143' TERM
trap 'exit 130' INT

# The gateway's network has nothing but a loopback interface of its own. So no browser reaches the ports of the plugins,
# which check no Origin; what enters and leaves passes the sockets.
# All of them end with this script, however it ends.
setpriv --pdeathsig KILL socat UNIX-LISTEN:robot.sock,fork TCP:127.0.0.1:"${ROBOT_PORT:-7448}",nodelay &
setpriv --pdeathsig KILL unshare --user --map-root-user --net --pid --fork --kill-child bash -c '
  ip link set lo up || exit
  socat TCP-LISTEN:7448,bind=127.0.0.1,fork,reuseaddr,nodelay UNIX-CONNECT:robot.sock &
  socat UNIX-LISTEN:remote_api.sock,fork TCP:127.0.0.1:10000,nodelay &
  socat UNIX-LISTEN:rest.sock,fork TCP:127.0.0.1:8000,nodelay &
  exec "$@"' gateway "$zenohd" -c "$config" &

user=""
[ "$(id -u)" != 0 ] || user="user root;"
setpriv --pdeathsig TERM nginx -p "$run" -e stderr -c "$here/nginx.conf" -g "daemon off; $user" &
echo "gateway: http://127.0.0.1:8080 (what is refused: $run/refused.log)"
grep -q '^ *{ rules: \["drive"' "$config" ||
  echo "gateway: its clients may watch and stop the robot, not drive it: the last lines of $config decide."
wait -n
echo "gateway: one of its programs ended." >&2
exit 70
