#!/usr/bin/env bash
# Reads and drives a robot with curl, through Zenoh's REST plugin: `robot.sh square`. It needs curl and jq.
# The contract of its commands and exit codes is in examples/clients/README.md.
set -uo pipefail
ROBOT="${ROBOT:-http://127.0.0.1:8080/rest}"
PREFIX="${NAMESPACE:+$NAMESPACE/}"
here="$(cd "$(dirname "$0")" && pwd)"

usage() {
  echo "usage: robot.sh pose | status | estop | release | set-pose X Y THETA | config | square [SIDE] | moves [SIDE]" >&2
  exit 64
}

fail() { # code, words
  echo "$2" >&2
  exit "$1"
}

# X-Yahboomd is what the gateway's nginx asks of programs. http_proxy would send commands somewhere else.
REQUEST=(--silent --fail --noproxy '*' --header 'X-Yahboomd: curl')
request() { curl "${REQUEST[@]}" "$@"; }

ask() { # key, request: prints the answer's payload. Without ?_raw the plugin wraps it, base64 in JSON.
  local answer
  answer="$(request --max-time 15 --data-binary "${2-}" "$ROBOT/$PREFIX$1?_raw")" ||
    fail 69 "No gateway answers at $ROBOT. Is it running, and yahboomd? (yahboomd run)"
  [[ "$answer" == \{* ]] ||
    fail 69 "Nothing behind $ROBOT answers $PREFIX$1. Is yahboomd running, with this NAMESPACE (yahboomd run),
and does gateway.json5 allow this key?"
  printf '%s\n' "$answer"
}

newest() { # key
  local answer
  answer="$(ask "$1")" || exit
  [ "$(jq 'has("success")' <<<"$answer")" = false ] || fail 69 "$(jq -r .message <<<"$answer")" # no sample yet
  printf '%s\n' "$answer"
}

call() { # service, request
  local answer
  answer="$(ask "$@")" || exit
  printf '%s\n' "$answer"
  [ "$(jq .success <<<"$answer")" = true ]
}

send() { # vx, wz
  request --max-time 0.3 --request PUT --header 'Content-Type: application/json' --output /dev/null \
    --data "{\"vx\": $1, \"wz\": $2, \"stamp_ns\": $(date +%s%N), \"source\": \"curl\"}" "$ROBOT/${PREFIX}cmd_vel"
}

# Each pose and status that arrives makes jq print a line: `go VX WZ`, `why WORDS` or `done JSON`. Where no line comes
# for 0.3 s, the robot is sent zero: this loop is the deadman. A slow gateway lets lines pile up in the pipe: of those
# that say `go` the newest counts.
square() { # side
  local status word one two last=0 silent=0
  status="$(newest yahboomd/status)" || exit
  # Anything else, a state of a later version too, is one in which the robot may not drive.
  [[ "$(jq -r .state <<<"$status")" == @(waiting|standing|driving|stopping) ]] ||
    fail 75 "The robot will not move. It is $(jq -r '"\(.state): \(.why)"' <<<"$status")"
  exec 3< <(request --no-buffer --header 'Accept: text/event-stream' "$ROBOT/${PREFIX}yahboomd/*" |
    jq --unbuffered --raw-input --raw-output --null-input --argjson side "$1" --from-file "$here/square.jq")
  trap 'send 0 0' EXIT
  trap 'exit 130' INT
  trap 'exit 143' TERM
  while :; do
    if read -r -t 0.3 word one two <&3; then
      silent=0
      while [ "$word" = go ] && read -r -t 0 <&3; do read -r -t 0.3 word one two <&3 || break; done
    elif [ $? -le 128 ]; then # the end of the stream, not of the time
      fail 75 "The gateway at $ROBOT ended the stream of poses; the square is given up."
    elif [ $((silent += 1)) -gt 100 ]; then
      fail 75 "No pose came from $ROBOT for 30 s; the square is given up."
    else
      word=go one=0 two=0
    fi
    case "$word" in
      go) # at most 20 commands a second, of which the newest pose decides
        [ $((${EPOCHREALTIME/[.,]/} - last)) -ge 48000 ] || continue
        last="${EPOCHREALTIME/[.,]/}"
        send "$one" "$two"
        ;;
      why) fail 75 "The robot will not move. $one $two" ;;
      done)
        echo "$one $two"
        return
        ;;
    esac
  done
}

# Each beat is a curl, which also asks for the progress; nothing else is started on the way, since processes take time.
# One loop sends and reads: if it stalls, or this shell is killed, no beat comes, and `yahboomd moves` stops the robot
# after half a second. There is no token by REST.
moves() { # side
  local request reply id beat news silent=0
  request="$(jq --null-input --argjson side "$1" '{kind: "straight", distance_m: $side} as $straight |
    {kind: "turn", angle_rad: 1.5707963267948966} as $turn | {by: "curl", moves: [range(4) | $straight, $turn]}')"
  reply="$(ask yahboomd/moves/start "$request")" || {
    echo "Does \`yahboomd moves\` run beside it?" >&2
    exit 69
  }
  [[ "$reply" =~ \"id\":\ ?\"([^\"]*)\" ]] || fail 75 "$(jq -r .message <<<"$reply")"
  id="${BASH_REMATCH[1]}"
  beat="{\"id\": \"$id\"}"
  trap "request --max-time 5 --data '$beat' --output /dev/null '$ROBOT/${PREFIX}yahboomd/moves/cancel?_raw'" EXIT
  trap 'exit 130' INT
  trap 'exit 143' TERM
  exec 3<> <(:) # Nothing ever comes: to wait without a process.
  until [ $((silent += 1)) -gt 20 ]; do # progress comes ten times a second
    news="$(request --max-time 0.4 --request PUT --data "$beat" --output /dev/null "$ROBOT/${PREFIX}yahboomd/moves/beat" \
      --next "${REQUEST[@]}" --max-time 0.4 "$ROBOT/${PREFIX}yahboomd/moves?_raw")"
    read -r -t 0.08 -u 3
    [[ "$news" =~ \"id\":\ ?\"$id\" ]] || continue
    silent=0
    [[ "$news" =~ \"done\":\ ?([0-9.e-]+).*\"left_s\":\ ?([0-9.e-]+) ]] &&
      LC_ALL=C printf '%.2f is done, %.1f s are left\n' "${BASH_REMATCH[1]}" "${BASH_REMATCH[2]}"
    if [[ "$news" =~ \"state\":\ ?\"ended\" ]]; then
      trap - EXIT
      printf '%s\n' "$news"
      [ "$(jq -r .reason <<<"$news")" = reached ] || fail 75 "$(jq -r .message <<<"$news")"
      return
    fi
  done
  fail 69 "\`yahboomd moves\` is gone: the robot stops by itself."
}

case "${1-} $#" in
  "pose 1" | "status 1") newest "yahboomd/$1" ;;
  "estop 1") call yahboomd/estop ;;
  "release 1") call yahboomd/estop/reset ;;
  "config 1") call yahboomd/config ;;
  "set-pose 4") call yahboomd/odometry/set_pose "{\"x\": $2, \"y\": $3, \"theta\": $4}" ;;
  "square 1" | "square 2") square "${2-1}" ;;
  "moves 1" | "moves 2") moves "${2-1}" ;;
  *) usage ;;
esac
