#!/usr/bin/env bash
robot="${ROBOT:-http://127.0.0.1:8080/rest}"
request() { curl --silent --show-error --fail --noproxy '*' --header 'X-Yahboomd: curl' "$@"; }

end=$((${EPOCHREALTIME/[.,]/} + 2000000)) # in 2 s
while [ "${EPOCHREALTIME/[.,]/}" -lt "$end" ]; do # a command lapses after 0.5 s, so repeat it
  request --request PUT --data '{"vx": 0.2, "wz": 0.5}' "$robot/cmd_vel" || exit
  request "$robot/yahboomd/pose?_raw" || exit
  echo
  sleep 0.1
done
request --request PUT --data '{"vx": 0, "wz": 0}' "$robot/cmd_vel"
