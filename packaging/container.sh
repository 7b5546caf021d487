#!/bin/sh
# The first process of the container. When it ends, the kernel kills every other one: so it outlives
# the daemon until the guard has seen the wheels stand, for 10 s at most, as under systemd.
[ "${1:-run}" = run ] || exec yahboomd "$@"

trap '[ -z "$!" ] || kill -TERM "$!"' TERM INT HUP
yahboomd "$@" <&0 &
# A signal interrupts `wait`.
while wait "$!"; status=$?; kill -0 "$!" 2>/dev/null; do :; done

tenths=100
while [ "$tenths" -gt 0 ] && grep -qs yahboomd-guard /proc/[0-9]*/comm; do
    sleep 0.1
    tenths=$((tenths - 1))
done
exit "$status"
