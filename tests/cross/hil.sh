#!/bin/sh
# hil.sh TILLER ROBOT LOGGER NATIVE FOREIGN EMULATOR...: hardware in the loop across architectures. The plant is a
# process of this machine (ODE, `tiller sim`), the controller is built for another and runs under its emulator; they
# speak LCM, in lockstep. To be run in a network namespace of its own (tests/io/in_network_namespace.sh).
#
#   1. NATIVE controller on the plant, while lcm-logger writes a log
#   2. FOREIGN controller on the same plant: the same commands, bit by bit
#   3. `tiller replay` feeds the log of 1 to the FOREIGN controller over LCM: every command as recorded, bit by bit
#
# Both controllers come from reproducible builds of tests/cross/lcm_runtime.cpp.
set -eu
tiller=$1 robot=$2 logger=$3 native=$4 foreign=$5
shift 5
seconds=3
work=$(mktemp -d)
pids=
logging=
cleanup() {
  # shellcheck disable=SC2086 # words on purpose
  [ -z "$pids" ] || kill $pids 2>/dev/null || true
  [ -z "$logging" ] || kill -s TERM -- "-$logging" 2>/dev/null || true
  rm -rf "$work"
}
trap cleanup EXIT

# loop NAME CONTROLLER...: plant and controller in lockstep; the controller's line goes to NAME
loop() {
  name=$1
  shift
  "$@" >"$work/$name" &
  controller=$!
  pids="$pids $controller"
  sleep 1 # both must listen before the first message
  "$tiller" sim "$robot" --serve lcm --lockstep --seconds "$seconds" --answer-timeout 60 >"$work/$name.plant" ||
    { cat "$work/$name.plant"; return 1; }
  wait "$controller" || { cat "$work/$name"; return 1; }
  echo "$name: $(cat "$work/$name")"
}

# the logger of the Python package is a script that starts the program: a group of its own, to end both
setsid "$logger" -q --flush-interval=1 "$work/log" >/dev/null 2>&1 &
logging=$!
sleep 2
loop native "$native"
sleep 2 # it writes once a second
kill -s TERM -- "-$logging"
wait "$logging" 2>/dev/null || true
logging=
log=$(find "$work" -name 'log*' | head -n 1)

loop foreign "$@" "$foreign"
cmp -s "$work/native" "$work/foreign" || { echo "the foreign controller sent other commands"; exit 1; }

"$@" "$foreign" >"$work/replay" &
pids="$pids $!"
sleep 1
"$tiller" replay "$log" "$robot" --through lcm --patience 60
